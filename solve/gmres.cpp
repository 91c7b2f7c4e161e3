#include <rubato/solve/gmres.hpp>

#include <cmath>
#include <stdexcept>

#include <fmt/core.h>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/reductions.hpp>

namespace rubato::solve {
namespace {

double norm(std::span<const double> v) {
  return std::sqrt(grids::dot(v, v));
}

/// y += factor x.
void add(double factor, std::span<const double> x, std::span<double> y) {
  grids::for_each_block(x.size(), 4096, [&, px = x.data(), py = y.data()](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      py[i] += factor * px[i];
    }
  });
}

void scale(double factor, std::span<double> x) {
  grids::for_each_block(x.size(), 4096, [&, p = x.data()](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      p[i] *= factor;
    }
  });
}

/// out = b - out.
void subtract_from(std::span<const double> b, std::span<double> out) {
  grids::for_each_block(b.size(), 4096, [p = b.data(), q = out.data()](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      q[i] = p[i] - q[i];
    }
  });
}

}  // namespace

Gmres::Gmres(std::size_t size, int restart) : size_(size), restart_(restart) {
  if (size < 1 || restart < 1 || restart > 1000) {
    throw std::invalid_argument(
        fmt::format("Gmres: size {} must be at least 1 and restart {} in 1..1000", size, restart));
  }
  const auto m = static_cast<std::size_t>(restart);
  basis_ = grids::Buffer((m + 1) * size);
  hessenberg_.resize((m + 1) * m);
  cosines_.resize(m);
  sines_.resize(m);
  reduced_.resize(m + 1);
}

GmresOutcome Gmres::solve(OperatorRef a, std::span<const double> b, std::span<double> x, const GmresOptions& options) {
  if (b.size() != size_ || x.size() != size_) {
    throw std::invalid_argument(
        fmt::format("Gmres: right-hand side of {} and solution of {} values, expected {}", b.size(), x.size(), size_));
  }
  GmresOutcome outcome;
  const double norm_b = norm(b);
  if (!std::isfinite(norm_b)) {
    outcome.status = Status::undefined;
    return outcome;
  }
  if (norm_b == 0.0) {
    grids::parallel_fill(x.data(), size_, 0.0);
    return outcome;
  }

  double previous = 0.0;  // the residual one cycle ago
  for (bool first = true;; first = false) {
    const std::span<double> r = basis(0);
    a(x.data(), r.data());
    subtract_from(b, r);
    const double beta = norm(r);
    outcome.residual = beta / norm_b;
    if (!std::isfinite(beta)) {
      outcome.status = Status::undefined;
      return outcome;
    }
    if (outcome.residual <= options.tolerance) {
      return outcome;
    }
    if (!first && outcome.residual > 0.5 * previous) {  // stagnation
      outcome.status = outcome.residual <= options.acceptable ? Status::success : Status::not_converged;
      return outcome;
    }
    if (outcome.iterations >= options.max_iterations) {
      outcome.status = outcome.residual <= options.acceptable ? Status::success : Status::not_converged;
      return outcome;
    }
    previous = outcome.residual;

    scale(1.0 / beta, r);
    reduced_.assign(reduced_.size(), 0.0);
    reduced_[0] = beta;
    int used = 0;
    bool invariant = false;  // the Krylov space is exhausted
    for (int j = 0; j < restart_ && outcome.iterations < options.max_iterations && !invariant; ++j) {
      ++outcome.iterations;
      double* h = hessenberg_.data() + static_cast<std::size_t>(j) * (restart_ + 1);
      const std::span<double> w = basis(j + 1);
      a(basis(j).data(), w.data());
      const double before = norm(w);
      for (int i = 0; i <= j; ++i) {
        h[i] = grids::dot(w, basis(i));
        add(-h[i], basis(i), w);
      }
      h[j + 1] = norm(w);
      if (!std::isfinite(h[j + 1])) {
        outcome.status = Status::undefined;
        return outcome;
      }
      used = j + 1;
      if (h[j + 1] <= 1e-15 * before) {
        invariant = true;
      } else {
        scale(1.0 / h[j + 1], w);
      }
      for (int i = 0; i < j; ++i) {
        const double upper = cosines_[i] * h[i] + sines_[i] * h[i + 1];
        h[i + 1] = -sines_[i] * h[i] + cosines_[i] * h[i + 1];
        h[i] = upper;
      }
      const double length = std::hypot(h[j], h[j + 1]);
      if (length <= 1e-15 * before) {  // A maps the space into a smaller one
        used = j;
        break;
      }
      cosines_[j] = h[j] / length;
      sines_[j] = h[j + 1] / length;
      h[j] = length;
      reduced_[j + 1] = -sines_[j] * reduced_[j];
      reduced_[j] *= cosines_[j];
      if (std::abs(reduced_[j + 1]) <= options.tolerance * norm_b) {
        break;
      }
    }
    if (used == 0) {
      outcome.status = Status::singular;
      return outcome;
    }
    for (int j = used - 1; j >= 0; --j) {
      for (int i = j + 1; i < used; ++i) {
        reduced_[j] -= hessenberg_[static_cast<std::size_t>(i) * (restart_ + 1) + j] * reduced_[i];
      }
      reduced_[j] /= hessenberg_[static_cast<std::size_t>(j) * (restart_ + 1) + j];
    }
    for (int j = 0; j < used; ++j) {
      add(reduced_[j], basis(j), x);
    }
  }
}

}  // namespace rubato::solve
