#pragma once

namespace rubato::detail {

/// Accuracy asked of a step whose length will still change: Newton's next correction of h squares the error anyway.
inline constexpr double loose = 1e-6;

}  // namespace rubato::detail
