#pragma once

namespace rubato::program {

/// Asks the system at once for the memory that any run takes, and keeps what is freed for what comes next: page by page
/// it is a tenth of a short run, on virtual machines above all. Where that is not to be had, nothing happens.
void prepare_heap();

}  // namespace rubato::program
