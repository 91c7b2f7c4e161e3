#include <rubato/ode/stage_kernels.hpp>

#include <type_traits>

#include <rubato/base/lanes.hpp>

namespace rubato::stages {
namespace {

template <std::size_t n>
struct Count {};

/// Rows of `width` places in vectors of `native` doubles, or of all if that is less.
template <int native, int width>
struct StageRows {
  static constexpr int lanes = native < width ? native : width;
  static constexpr int parts = width / lanes;
  /// Rows that are summed at a time, so that sums do not wait for each other and stay in registers.
  static constexpr std::size_t block = lanes == 8 ? 4 : parts == 1 ? 2 : 1;
  using V = typename VectorOf<lanes>::type;

  static V load(const double* from) {
    V v;
    __builtin_memcpy(&v, from, sizeof(V));
    return v;
  }
  static void store(double* to, V v) { __builtin_memcpy(to, &v, sizeof(V)); }
  static std::size_t at(int part) { return static_cast<std::size_t>(part * lanes); }
  static V magnitude(V v) {
    using Bits = decltype(v < v);
    constexpr long long no_sign = 0x7fffffffffffffff;
    return reinterpret_cast<V>(reinterpret_cast<Bits>(v) & no_sign);
  }
  static V larger_of(V a, V b) { return a > b ? a : b; }
  /// The largest of its numbers, which are none of them below 0.
  static double largest(V v) {
    if constexpr (lanes == 8) {
      const auto low = __builtin_shufflevector(v, v, 0, 1, 2, 3), high = __builtin_shufflevector(v, v, 4, 5, 6, 7);
      return StageRows<4, 4>::largest(low > high ? low : high);
    } else if constexpr (lanes == 4) {
      const auto low = __builtin_shufflevector(v, v, 0, 1), high = __builtin_shufflevector(v, v, 2, 3);
      return StageRows<2, 2>::largest(low > high ? low : high);
    } else {
      return v[0] > v[1] ? v[0] : v[1];
    }
  }

  /// The sums of `count` rows, each handed to done(row, part, sum): those over even and odd stages added, so that half
  /// as many wait for each other.
  template <std::size_t count, bool two, typename Done>
  static void sum_some(int stages, const double* from, const double* first, const double* second, double factor,
                       const Done& done) {
    V a[count][parts][2] = {}, b[count][parts][2] = {};
    const auto add = [&](int j, int half) {
      for (int p = 0; p < parts; ++p) {
        const V weight = load(first + j * width + p * lanes);
        const V rest = two ? load(second + j * width + p * lanes) : weight;
        for (std::size_t r = 0; r < count; ++r) {
          const double value = from[r * width + static_cast<std::size_t>(j)];
          a[r][p][half] += value * weight;
          if constexpr (two) {
            b[r][p][half] += value * rest;
          }
        }
      }
    };
    int j = 0;
    for (; j + 2 <= stages; j += 2) {
      add(j, 0);
      add(j + 1, 1);
    }
    if (j < stages) {
      add(j, 0);
    }
    for (std::size_t r = 0; r < count; ++r) {
      for (int p = 0; p < parts; ++p) {
        const V sum = a[r][p][0] + a[r][p][1];
        done(r, p, factor * (two ? sum + (b[r][p][0] + b[r][p][1]) : sum));
      }
    }
  }
  /// some(count, first row), of as many rows at a time as there are registers for.
  template <typename Some>
  static void for_rows(std::size_t rows, const Some& some) {
    std::size_t r = 0;
    for (; r + block <= rows; r += block) {
      some(Count<block>{}, r);
    }
    if constexpr (block > 2) {
      for (; r + 2 <= rows; r += 2) {
        some(Count<2>{}, r);
      }
    }
    for (; r < rows; ++r) {
      some(Count<1>{}, r);
    }
  }

  static void combine(std::size_t rows, int stages, const double* from, const double* first, const double* second,
                      double factor, double* to) {
    for_rows(rows, [&]<std::size_t count>(Count<count>, std::size_t r) {
      const auto keep = [&](std::size_t row, int p, V sum) { store(to + (r + row) * width + at(p), sum); };
      if (second != nullptr) {
        sum_some<count, true>(stages, from + r * width, first, second, factor, keep);
      } else {
        sum_some<count, false>(stages, from + r * width, first, second, factor, keep);
      }
    });
  }

  static double correct(std::size_t rows, int stages, const double* from, const double* first, const double* second,
                        double factor, const double* floor, const double* high, const double* low, double* Y,
                        double* correction, double* to) {
    RelativeSize relative;
    for_rows(rows, [&]<std::size_t count>(Count<count>, std::size_t r) {
      V size[count] = {}, scale[count] = {};
      sum_some<count, true>(stages, from + r * width, first, second, factor, [&](std::size_t row, int p, V sum) {
        const std::size_t place = (r + row) * width + at(p);
        const V y = load(Y + place), c = sum - y;
        store(correction + place, c);
        store(Y + place, sum);
        store(to + place, high[r + row] + (low[r + row] + sum));
        relative.take(y, c, size[row], scale[row]);
      });
      for (std::size_t row = 0; row < count; ++row) {
        relative.close(size[row], scale[row], floor[r + row]);
      }
    });
    return relative.result();
  }

  static void gather(std::size_t rows, int stages, const double* from, const double* first, const double* second,
                     double factor, const double* base, const double* rest, double* to) {
    for_rows(rows, [&]<std::size_t count>(Count<count>, std::size_t r) {
      sum_some<count, true>(stages, from + r * width, first, second, factor, [&](std::size_t row, int p, V sum) {
        const std::size_t place = (r + row) * width + at(p);
        store(to + place, load(base + place) + (load(rest + place) + sum));
      });
    });
  }

  static double mend(std::size_t rows, const double* from, double factor, const double* floor, const double* high,
                     const double* low, double* Y, double* correction, double* to) {
    RelativeSize relative;
    for (std::size_t r = 0; r < rows; ++r) {
      V size = {}, scale = {};
      for (int p = 0; p < parts; ++p) {
        const std::size_t place = r * width + at(p);
        const V y = load(Y + place), mended = factor * load(from + place), c = mended - y;
        store(correction + place, c);
        store(Y + place, mended);
        store(to + place, high[r] + (low[r] + mended));
        relative.take(y, c, size, scale);
      }
      relative.close(size, scale, floor[r]);
    }
    return relative.result();
  }

  static void place(std::size_t rows, const double* high, const double* low, const double* Y, double* to) {
    for (std::size_t r = 0; r < rows; ++r) {
      for (int p = 0; p < parts; ++p) {
        const std::size_t place = r * width + at(p);
        store(to + place, high[r] + (low[r] + load(Y + place)));
      }
    }
  }

  static void begin(std::size_t rows, int stages, const double* from, const double* first, double factor,
                    const double* more, double weight, double* base, double* to) {
    for_rows(rows, [&]<std::size_t count>(Count<count>, std::size_t r) {
      sum_some<count, false>(stages, from + r * width, first, nullptr, factor, [&](std::size_t row, int p, V sum) {
        const std::size_t place = (r + row) * width + at(p);
        store(base + place, sum);
        store(to + place, sum + weight * load(more + place));
      });
    });
  }

  /// Takes in rows, part by part.
  struct RelativeSize {
    V any = {};  ///< knows of a NaN
    double most = 0.0;

    void take(V y, V correction, V& size, V& scale) {
      const V c = magnitude(correction);
      any += c;
      size = larger_of(size, c);
      scale = larger_of(larger_of(scale, c), magnitude(y));
    }
    void close(V size, V scale, double floor) {
      const double numerator = largest(size), denominator = largest(scale);
      if (numerator != 0.0) {
        const double ratio = numerator / (denominator > floor ? denominator : floor);
        most = most >= ratio ? most : ratio;
      }
    }
    [[nodiscard]] double result() const {
      const V defined = {}, undefined = defined + 1.0;
      return largest(any == any ? defined : undefined) == 0.0 ? most : __builtin_nan("");
    }
  };
  static double relative_size(std::size_t rows, const double* Y, const double* correction, const double* floor) {
    RelativeSize relative;
    for (std::size_t r = 0; r < rows; ++r) {
      V size = {}, scale = {};
      for (int p = 0; p < parts; ++p) {
        const std::size_t place = r * width + at(p);
        relative.take(load(Y + place), load(correction + place), size, scale);
      }
      relative.close(size, scale, floor[r]);
    }
    return relative.result();
  }
};

/// call(StageRows<native, width>) for rows of so many stages, by this machine's vectors.
template <typename Call>
auto with_rows(int stages, const Call& call) {
  return in_vectors(vector_lanes(), [&]<int native>(std::integral_constant<int, native>) {
    switch (row_length(stages)) {
      case 2: return call(StageRows<native, 2>());
      case 4: return call(StageRows<native, 4>());
      default: return call(StageRows<native, 8>());
    }
  });
}

}  // namespace

void combine(std::size_t rows, int stages, const double* from, const double* first, const double* second, double factor,
             double* to) {
  return with_rows(stages,
                   [=](auto kernels) { return kernels.combine(rows, stages, from, first, second, factor, to); });
}

double correct(std::size_t rows, int stages, const double* from, const double* first, const double* second,
               double factor, const double* floor, const double* high, const double* low, double* Y, double* correction,
               double* to) {
  return with_rows(stages, [=](auto kernels) {
    return kernels.correct(rows, stages, from, first, second, factor, floor, high, low, Y, correction, to);
  });
}

void gather(std::size_t rows, int stages, const double* from, const double* first, const double* second, double factor,
            const double* base, const double* rest, double* to) {
  return with_rows(
      stages, [=](auto kernels) { return kernels.gather(rows, stages, from, first, second, factor, base, rest, to); });
}

double mend(std::size_t rows, int stages, const double* from, double factor, const double* floor, const double* high,
            const double* low, double* Y, double* correction, double* to) {
  return with_rows(stages,
                   [=](auto kernels) { return kernels.mend(rows, from, factor, floor, high, low, Y, correction, to); });
}

void place(std::size_t rows, int stages, const double* high, const double* low, const double* Y, double* to) {
  return with_rows(stages, [=](auto kernels) { return kernels.place(rows, high, low, Y, to); });
}

void begin(std::size_t rows, int stages, const double* from, const double* first, double factor, const double* more,
           double weight, double* base, double* to) {
  return with_rows(
      stages, [=](auto kernels) { return kernels.begin(rows, stages, from, first, factor, more, weight, base, to); });
}

double relative_size(std::size_t rows, int stages, const double* Y, const double* correction, const double* floor) {
  return with_rows(stages, [=](auto kernels) { return kernels.relative_size(rows, Y, correction, floor); });
}

}  // namespace rubato::stages
