#pragma once

/// \file
/// Everything a user of the library needs.
