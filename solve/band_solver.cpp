#include <rubato/solve/band_solver.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/core.h>

#include <rubato/base/all_finite.hpp>
#include <rubato/solve/elimination.hpp>

namespace rubato::solve {

BandSolver::BandSolver(int n, int lower, int upper) : n_(n), lower_(lower), upper_(upper) {
  if (n < 1 || lower < 0 || upper < 0 || lower >= n || upper >= n) {
    throw std::invalid_argument(
        fmt::format("a band of {} diagonals below the main one and {} above in a matrix of {} rows", lower, upper, n));
  }
  stride_ = static_cast<std::size_t>(2 * lower + upper + 1);
  entries_.resize(stride_ * static_cast<std::size_t>(n));
  pivots_.resize(static_cast<std::size_t>(n));
}

void BandSolver::clear() {
  std::ranges::fill(entries_, 0.0);
}

Status BandSolver::factor() {
  if (!all_finite(entries_)) {
    return Status::undefined;
  }
  const std::size_t along = stride_ - 1;  // from one column to the next within a row
  int last = 0;                           // column reached by the rows that came up so far
  for (int k = 0; k < n_; ++k) {
    double* const column = &entries_[place(k, k)];
    const int below = std::min(lower_, n_ - 1 - k);
    int row = 0;
    for (int i = 1; i <= below; ++i) {
      if (std::abs(column[i]) > std::abs(column[row])) {
        row = i;
      }
    }
    pivots_[static_cast<std::size_t>(k)] = k + row;
    last = std::max(last, std::min(k + row + upper_, n_ - 1));
    if (row != 0) {
      double* entry = column;
      for (int j = k; j <= last; ++j, entry += along) {
        std::swap(entry[0], entry[row]);
      }
    }
    if (!elimination::usable(column[0])) {
      return elimination::judge(column[0]);
    }
    const double reciprocal = 1.0 / column[0];
    for (int i = 1; i <= below; ++i) {
      column[i] *= reciprocal;
    }
    double* entry = column + along;
    for (int j = k + 1; j <= last; ++j, entry += along) {
      const double factor = entry[0];
      for (int i = 1; i <= below; ++i) {
        entry[i] -= column[i] * factor;
      }
    }
  }
  return Status::success;
}

void BandSolver::solve(double* b) const {
  for (int k = 0; k < n_; ++k) {
    std::swap(b[k], b[pivots_[static_cast<std::size_t>(k)]]);
    const double* const column = &entries_[place(k, k)];
    const int below = std::min(lower_, n_ - 1 - k);
    for (int i = 1; i <= below; ++i) {
      b[k + i] -= column[i] * b[k];
    }
  }
  for (int k = n_ - 1; k >= 0; --k) {
    const double* const column = &entries_[place(k, k)];
    b[k] /= column[0];
    const int above = std::min(lower_ + upper_, k);
    for (int i = 1; i <= above; ++i) {
      b[k - i] -= column[-i] * b[k];
    }
  }
}

namespace {

using Neighbours = std::vector<std::vector<int>>;

/// Vertices level by level from one, each level's by their degree. `reached` holds a number of this walk for all.
std::vector<int> breadth_first(const Neighbours& neighbours, int start, std::vector<int>& reached, int walk,
                               std::size_t& last_level) {
  std::vector<int> order = {start};
  reached[static_cast<std::size_t>(start)] = walk;
  last_level = 0;
  std::size_t level_end = 1;
  for (std::size_t next = 0; next < order.size(); ++next) {
    if (next == level_end) {
      last_level = next;
      level_end = order.size();
    }
    for (const int neighbour : neighbours[static_cast<std::size_t>(order[next])]) {
      if (int& mark = reached[static_cast<std::size_t>(neighbour)]; mark != walk) {
        mark = walk;
        order.push_back(neighbour);
      }
    }
  }
  return order;
}

}  // namespace

std::vector<int> reverse_cuthill_mckee(int n, std::span<const std::pair<int, int>> edges) {
  const auto count = static_cast<std::size_t>(n);
  Neighbours neighbours(count);
  for (const auto& [a, b] : edges) {
    if (a != b) {
      neighbours[static_cast<std::size_t>(a)].push_back(b);
      neighbours[static_cast<std::size_t>(b)].push_back(a);
    }
  }
  for (std::vector<int>& list : neighbours) {
    std::ranges::sort(list);
    list.erase(std::unique(list.begin(), list.end()), list.end());
  }
  const auto degree = [&](int vertex) { return neighbours[static_cast<std::size_t>(vertex)].size(); };
  for (std::vector<int>& list : neighbours) {
    std::ranges::stable_sort(list, {}, degree);
  }
  std::vector<int> order, reached(count, -1);
  int walk = 0;
  std::vector<bool> done(count, false);
  for (int vertex = 0; vertex < n; ++vertex) {
    if (done[static_cast<std::size_t>(vertex)]) {
      continue;
    }
    // A vertex far from another one, by two walks: its levels are many, and so small.
    int start = vertex;
    std::size_t last_level = 0;
    for (int turn = 0; turn < 2; ++turn) {
      const std::vector<int> walked = breadth_first(neighbours, start, reached, walk++, last_level);
      start = *std::min_element(walked.begin() + static_cast<std::ptrdiff_t>(last_level), walked.end(),
                                [&](int a, int b) { return degree(a) < degree(b); });
    }
    for (const int next : breadth_first(neighbours, start, reached, walk++, last_level)) {
      done[static_cast<std::size_t>(next)] = true;
      order.push_back(next);
    }
  }
  std::vector<int> places(count);
  for (std::size_t k = 0; k < count; ++k) {
    places[static_cast<std::size_t>(order[k])] = n - 1 - static_cast<int>(k);
  }
  return places;
}

}  // namespace rubato::solve
