#include <rubato/solve/block_qr_reduction.hpp>

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <utility>

#include <rubato/base/lanes.hpp>

namespace rubato::solve::chunks {
namespace {

/// f(0), …, f(count - 1); for a std::integral_constant the calls are written out, with constants as arguments, so that
/// the loops inside them have constant bounds and arrays live in registers.
template <class Count, class F>
[[gnu::always_inline]] inline void repeat(Count count, F&& f) {
  if constexpr (std::is_same_v<Count, int>) {
    for (int i = 0; i < count; ++i) {
      f(i);
    }
  } else {
    [&]<int... I>(std::integer_sequence<int, I...>) {
      (f(std::integral_constant<int, I>{}), ...);
    }
    (std::make_integer_sequence<int, Count::value>{});
  }
}

template <int lanes, int Fixed>
struct Elimination {
  using V = typename VectorOf<lanes>::type;
  static constexpr int largest = Fixed > 0 ? Fixed : 16;

  const System& system;
  const Shape shape;
  std::size_t first;
  std::size_t begin[lanes];   ///< first cell of each lane's chunk
  std::size_t length[lanes];  ///< its number of cells
  std::size_t steps = 0;      ///< the longest of them
  std::size_t common = 0;     ///< the shortest of them: at most one less
  V* cell;                    ///< record of the cell being taken in
  V* state;                   ///< record of the chunk so far
  V* kept;                    ///< the same, for lanes that have come to their end
  V* slots;                   ///< U, G, R, X of each eliminated node
  V* spare;

  Elimination(const System& s, std::size_t first_chunk, double* workspace)
      : system(s), shape(s.shape), first(first_chunk), cell(reinterpret_cast<V*>(workspace)) {
    for (int l = 0; l < lanes; ++l) {
      // Lanes past the last chunk repeat it; what they compute is not stored.
      const std::size_t chunk = std::min(first + l, s.end_chunk() - 1);
      begin[l] = s.first_cell(chunk);
      length[l] = s.first_cell(chunk + 1) - begin[l];
      steps = std::max(steps, length[l]);
      common = l == 0 ? length[l] : std::min(common, length[l]);
    }
    state = cell + shape.record();
    kept = state + shape.record();
    slots = kept + shape.record();
    spare = slots + steps * shape.slot();
    clear(cell, shape.record());
    if (s.matrix != nullptr) {
      load_constants();
    }
  }

  static void copy(const V* from, int count, V* to) { std::copy_n(from, count, to); }
  static void clear(V* values, int count) { std::fill_n(values, count, V{}); }
  static V root(V v) {
    for (int l = 0; l < lanes; ++l) {
      v[l] = std::sqrt(v[l]);
    }
    return v;
  }

  /// The block size: a constant for the sizes with code of their own.
  [[nodiscard]] auto d() const {
    if constexpr (Fixed > 0) {
      return std::integral_constant<int, Fixed>{};
    } else {
      return shape.d;
    }
  }
  [[nodiscard]] int active() const {
    return static_cast<int>(std::min<std::size_t>(lanes, system.end_chunk() - first));
  }

  void load_constants() {
    const auto n = d();
    for (int r = 0; r < n; ++r) {
      for (int c = 0; c < n; ++c) {
        cell[r + c * n] = V{} + system.matrix->left[r * n + c];
        cell[shape.right() + r + c * n] = V{} + system.matrix->right[r * n + c];
      }
    }
    for (int b = 0; b < shape.borders; ++b) {
      for (int f = 0; f < n; ++f) {
        cell[shape.extra() + b * n + f] = V{} + system.border->columns[b * n + f].constant;
        cell[shape.first_row() + b * n + f] = V{} + system.border->rows[b * n + f].constant;
      }
    }
  }

  V gather(const double* values, std::size_t step) const {
    V v;
    for (int l = 0; l < lanes; ++l) {
      v[l] = values[begin[l] + std::min(step, length[l] - 1)];
    }
    return v;
  }

  void load_from_matrix(std::size_t step) {
    const auto n = d();
    const CyclicBidiagonal& m = *system.matrix;
    for (const CyclicEntry& e : m.entries) {
      cell[e.row + e.column * n] = V{} + m.left[e.row * n + e.column];
      cell[shape.right() + e.row + e.column * n] = V{} + m.right[e.row * n + e.column];
    }
    for (const CyclicEntry& e : m.entries) {
      const V value = gather(e.values, step);
      cell[e.row + e.column * n] += e.left * value;
      cell[shape.right() + e.row + e.column * n] += e.right * value;
    }
    if (m.closes() && begin[lanes - 1] + step + 1 >= system.cells) {  // lanes are in order
      load_last(step);
    }
    for (int j = 0; j < shape.borders * n; ++j) {
      if (const auto& c = system.border->columns[j]; c.values != nullptr) {
        cell[shape.extra() + j] = c.constant + gather(c.values, step);
      }
      if (const auto& c = system.border->rows[j]; c.values != nullptr) {
        cell[shape.first_row() + j] = c.constant + gather(c.values, step);
      }
    }
    for (int j = 0; j < shape.columns * n; ++j) {
      cell[shape.extra() + shape.borders * n + j] = gather(system.rhs[j], step);
    }
  }

  /// Into the lanes that have come to the last cell, which is the last that they load.
  void load_last(std::size_t step) {
    const auto n = d();
    const CyclicBidiagonal& m = *system.matrix;
    for (int l = 0; l < lanes; ++l) {
      if (begin[l] + std::min(step, length[l] - 1) + 1 < system.cells) {
        continue;
      }
      for (int r = 0; r < n; ++r) {
        for (int c = 0; c < n; ++c) {
          cell[r + c * n][l] = m.last_left[r * n + c];
          cell[shape.right() + r + c * n][l] = m.last_right[r * n + c];
        }
      }
    }
  }

  [[nodiscard]] const double* before_first() const {
    return system.part != nullptr ? system.part->before : system.records + (system.cells - 1) * shape.record();
  }

  void load_from_records(std::size_t step) {
    const int size = shape.record();
    for (int l = 0; l < lanes; ++l) {
      const std::size_t i = begin[l] + std::min(step, length[l] - 1);
      const double* own = system.records + i * size;
      const double* previous = i > 0 ? own - size : before_first();
      for (int j = 0; j < size; ++j) {
        cell[j][l] = own[j];
      }
      for (int j = 0; j < shape.borders * d(); ++j) {
        cell[shape.first_row() + j][l] += previous[shape.last_row() + j];
      }
    }
  }

  /// Takes in a cell of every lane. A lane whose chunk has come to its end gets its last cell again.
  void load(std::size_t step) {
    if (system.matrix != nullptr) {
      load_from_matrix(step);
    } else {
      load_from_records(step);
    }
  }

  /// Gives lanes whose chunk had come to its end before `step` back what they had: which chunks share a group, hence
  /// the number of lanes, must not matter to any of them.
  void keep_ended(std::size_t step, V* values, const V* before, int count) const {
    for (int l = 0; l < lanes; ++l) {
      for (int j = 0; step >= length[l] && j < count; ++j) {
        values[j][l] = before[j][l];
      }
    }
  }

  enum class Filled { top, bottom, all };  ///< which half of a column of 2d rows is not zero

  /// Applies the reflections I - v vᵀ factor of the first `count` columns to one more column.
  template <Filled filled, class Count>
  [[gnu::always_inline]] void reflect(V* a, const V (*v)[2 * largest], const V* factor, Count count) const {
    const auto n = d();
    repeat(count, [&](auto p) {
      // Before the first reflection one half is zero.
      const int from = p == 0 && filled == Filled::bottom ? n : p;
      const int to = p == 0 && filled == Filled::top ? n : 2 * n;
      V sum = v[p][from] * a[from];
      for (int i = from + 1; i < to; ++i) {
        sum += v[p][i] * a[i];
      }
      sum *= factor[p];
      for (int i = p; i < 2 * n; ++i) {
        a[i] -= sum * v[p][i];
      }
    });
  }

  /// [G E 0 X; 0 L R X'] → Qᵀ · that = [G₁ U R₁ X₁; G₂ 0 E₂ X₂]: the upper rows determine the node and go to its slot,
  /// the lower ones replace the state.
  void eliminate(V* slot) {
    const auto n = d();
    V v[largest][2 * largest];
    V factor[largest];
    V a[2 * largest];
    V* u = slot;
    repeat(n, [&](auto p) {
      repeat(n, [&](auto i) {
        a[i] = state[shape.right() + p * n + i];
        a[n + i] = cell[p * n + i];
      });
      reflect<Filled::all>(a, v, factor, p);
      V square = a[p] * a[p];
      for (int i = p + 1; i < 2 * n; ++i) {
        square += a[i] * a[i];
      }
      const V norm = root(square);
      const V beta = a[p] < V{} ? norm : -norm;  // U_pp; the sign avoids cancellation in v_p
      repeat(p, [&](auto i) { u[p * n + i] = a[i]; });
      repeat(n, [&](auto i) {
        v[p][i] = a[i];
        v[p][n + i] = a[n + i];
      });
      v[p][p] = a[p] - beta;
      const V quotient = 1.0 / (beta * v[p][p]);  // vᵀv = -2 β v_p
      factor[p] = -quotient;
      u[p * n + p] = v[p][p] * quotient;  // 1 / U_pp
    });
    V* g = slot + n * n;
    V* r = g + n * n;
    V* x = r + n * n;
    for (int c = 0; c < n; ++c) {
      repeat(n, [&](auto i) {
        a[i] = state[c * n + i];
        a[n + i] = V{};
      });
      reflect<Filled::top>(a, v, factor, n);
      repeat(n, [&](auto i) {
        g[c * n + i] = a[i];
        state[c * n + i] = a[n + i];
      });
    }
    for (int c = 0; c < n; ++c) {
      repeat(n, [&](auto i) {
        a[i] = V{};
        a[n + i] = cell[shape.right() + c * n + i];
      });
      reflect<Filled::bottom>(a, v, factor, n);
      repeat(n, [&](auto i) {
        r[c * n + i] = a[i];
        state[shape.right() + c * n + i] = a[n + i];
      });
    }
    for (int c = 0; c < shape.extras(); ++c) {
      V* own = state + shape.extra() + c * n;
      repeat(n, [&](auto i) {
        a[i] = own[i];
        a[n + i] = cell[shape.extra() + c * n + i];
      });
      reflect<Filled::all>(a, v, factor, n);
      repeat(n, [&](auto i) {
        x[c * n + i] = a[i];
        own[i] = a[n + i];
      });
    }
  }

  /// The border rows: with z_j = U⁻¹(x - G z_a - R z_{j+1} - B y), the part c z_j of each becomes coefficients of z_a,
  /// z_{j+1}, y and a part of its right-hand side.
  void eliminate_from_borders(const V* slot) {
    const auto n = d();
    const V* u = slot;
    const V* g = slot + n * n;
    const V* r = g + n * n;
    const V* x = r + n * n;
    V w[largest];
    for (int b = 0; b < shape.borders; ++b) {
      V* last = state + shape.last_row() + b * n;
      for (int p = 0; p < n; ++p) {  // w = c U⁻¹
        V sum = last[p] + cell[shape.first_row() + b * n + p];
        for (int i = 0; i < p; ++i) {
          sum -= w[i] * u[p * n + i];
        }
        w[p] = sum * u[p * n + p];
      }
      const auto product = [&](const V* column) {
        V sum = w[0] * column[0];
        for (int i = 1; i < n; ++i) {
          sum += w[i] * column[i];
        }
        return sum;
      };
      for (int c = 0; c < n; ++c) {
        state[shape.first_row() + b * n + c] -= product(g + c * n);
        last[c] = -product(r + c * n);
      }
      for (int c = 0; c < shape.extras(); ++c) {
        V& share = state[shape.share() + b * shape.extras() + c];
        share += cell[shape.share() + b * shape.extras() + c] - product(x + c * n);
      }
    }
  }

  /// Eliminates all nodes but the first of each chunk. \param keeps_slots of each node, to substitute()
  void sweep(bool keeps_slots) {
    load(0);
    copy(cell, shape.record(), state);
    clear(state + shape.last_row(), shape.share() - shape.last_row());
    for (std::size_t step = 1; step < steps; ++step) {
      load(step);
      if (step >= common) {
        copy(state, shape.record(), kept);
      }
      V* const slot = slots + (keeps_slots ? step * shape.slot() : 0);
      eliminate(slot);
      if (shape.borders > 0 && !keeps_slots) {
        eliminate_from_borders(slot);
      }
      if (step >= common) {
        keep_ended(step, state, kept, shape.record());
      }
    }
  }

  /// What is left of each chunk.
  void store_reduced(double* reduced) const {
    const int size = shape.record();
    for (int l = 0; l < active(); ++l) {
      for (int j = 0; j < size; ++j) {
        reduced[(first - system.first_chunk() + l) * size + j] = state[j][l];
      }
    }
  }

  void store(const Solution& to, std::size_t step, const V* z) {
    const auto n = d();
    for (int l = 0; l < active(); ++l) {
      if (step >= length[l]) {
        continue;
      }
      const std::size_t node = begin[l] + step;
      for (int j = 0; j < shape.columns * n; ++j) {
        if (to.nodes != nullptr) {
          to.nodes[node * shape.columns * n + j] = z[j][l];
        } else {
          to.fields[j][node] = z[j][l];
        }
      }
    }
  }

  /// The eliminated nodes, by their slots.
  void substitute(const Solution& solution) {
    const auto n = d();
    const int per_node = shape.columns * n;
    V* start = spare;
    V* next = start + per_node;
    for (int l = 0; l < lanes; ++l) {
      const std::size_t chunk = std::min(first + l, system.end_chunk() - 1) - system.first_chunk();
      const std::size_t following = system.part == nullptr && chunk + 1 == system.chunks ? 0 : chunk + 1;
      for (int j = 0; j < per_node; ++j) {
        start[j][l] = solution.separators[chunk * per_node + j];
        next[j][l] = solution.separators[following * per_node + j];
      }
    }
    store(solution, 0, start);
    for (std::size_t step = steps - 1; step > 0; --step) {
      if (step >= common) {
        copy(next, per_node, kept);
      }
      const V* u = slots + step * shape.slot();
      const V* g = u + n * n;
      const V* r = g + n * n;
      const V* x = r + n * n;
      for (int column = 0; column < shape.columns; ++column) {
        const V* z_start = start + column * n;
        V* z = next + column * n;  // z_{j+1}, replaced by z_j
        V a[largest];
        repeat(n, [&](auto i) { a[i] = x[(shape.borders + column) * n + i]; });
        for (int b = 0; b < shape.borders; ++b) {
          const double y = solution.border[column * shape.borders + b];
          for (int i = 0; i < n; ++i) {
            a[i] -= x[b * n + i] * y;
          }
        }
        for (int c = 0; c < n; ++c) {
          for (int i = 0; i < n; ++i) {
            a[i] -= g[c * n + i] * z_start[c];
          }
        }
        for (int c = 0; c < n; ++c) {
          for (int i = 0; i < n; ++i) {
            a[i] -= r[c * n + i] * z[c];
          }
        }
        for (int p = n - 1; p >= 0; --p) {
          a[p] *= u[p * n + p];
          for (int i = 0; i < p; ++i) {
            a[i] -= u[p * n + i] * a[p];
          }
        }
        repeat(n, [&](auto i) { z[i] = a[i]; });
      }
      if (step >= common) {
        keep_ended(step, next, kept, per_node);
      }
      store(solution, step, next);
    }
  }
};

/// The fewest lanes for which block sizes have code of their own: two are what processors before AVX2 have.
#if defined(__x86_64__)
constexpr int fewest_with_sizes = 4;
#else
constexpr int fewest_with_sizes = 2;
#endif

/// Reduces chunks, or where there is a solution to expand, expands it: one function, so that the elimination is
/// compiled once. The common block sizes have code of their own, with loops unrolled.
void eliminate(int lanes, const System& system, std::size_t first, double* workspace, double* reduced,
               const Solution* solution) {
  const auto use = [=](auto&& elimination) {
    elimination.sweep(solution != nullptr);
    if (solution != nullptr) {
      elimination.substitute(*solution);
    } else {
      elimination.store_reduced(reduced);
    }
  };
  in_vectors(lanes, [&]<int fixed>(std::integral_constant<int, fixed>) {
    if constexpr (fixed >= fewest_with_sizes) {
      switch (system.shape.d) {
        case 2: return use(Elimination<fixed, 2>(system, first, workspace));
        case 3: return use(Elimination<fixed, 3>(system, first, workspace));
        case 4: return use(Elimination<fixed, 4>(system, first, workspace));
        case 5: return use(Elimination<fixed, 5>(system, first, workspace));
        case 6: return use(Elimination<fixed, 6>(system, first, workspace));
        default: break;
      }
    }
    return use(Elimination<fixed, 0>(system, first, workspace));
  });
}

}  // namespace

void reduce(int lanes, const System& system, std::size_t first, double* workspace, double* reduced) {
  eliminate(lanes, system, first, workspace, reduced, nullptr);
}

void expand(int lanes, const System& system, std::size_t first, double* workspace, const Solution& solution) {
  eliminate(lanes, system, first, workspace, nullptr, &solution);
}

}  // namespace rubato::solve::chunks
