#include <rubato/pde/linear_waves.hpp>

#include <algorithm>
#include <array>
#include <iterator>
#include <limits>
#include <numbers>
#include <numeric>

#include <fmt/format.h>

#include <rubato/grids/transposition.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/potential_rest.hpp>
#include <rubato/pde/wave_loops.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;

/// Into rows of zeros: those that stay zero take no memory.
void set_wave(const MatrixXcd& values, std::size_t wave, WaveRows& rows) {
  const auto set = [wave](double value, double* row) {
    if (value != 0.0) {
      row[wave] = value;
    }
  };
  for (Index r = 0; r < values.rows(); ++r) {
    for (Index c = 0; c < values.cols(); ++c) {
      const auto row = static_cast<std::size_t>(r * values.cols() + c);
      set(values(r, c).real(), rows.re.pointers()[row]);
      set(values(r, c).imag(), rows.im.pointers()[row]);
    }
  }
}

}  // namespace

LinearWaves::LinearWaves(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation,
                         const grids::Fourier& fourier)
    : system_(system),
      grid_(grid),
      collocation_(collocation),
      fourier_(fourier),
      has_mean_(fourier.modes() > 0 && fourier.wave(0) == std::array<std::ptrdiff_t, 3>{}) {
  split_fields();
  L_ = hessian_of_waves(system, grid);
  find_translation();
  reduce();
  group();
  parseval_ = parseval_weights(fourier_, grid);
  find_real_forms();
}

void LinearWaves::split_fields() {
  for (int f = 0; f < system_.field_count(); ++f) {
    const auto& name = system_.fields()[static_cast<std::size_t>(f)];
    if (system_.structure().at_midpoints(f)) {
      throw SchemeRefusal(
          fmt::format("splitting needs a linear part that can be solved for all fields without an equation of motion, "
                      "and {} has none: only a whole step determines it{}",
                      name, splitting_remedy));
    }
    (system_.structure().algebraic[static_cast<std::size_t>(f)] ? others_ : evolving_).push_back(f);
  }
  MatrixXd M(size(), size());
  for (int r = 0; r < size(); ++r) {
    for (int c = 0; c < size(); ++c) {
      M(r, c) = system_.M()(evolving_[static_cast<std::size_t>(r)], evolving_[static_cast<std::size_t>(c)]);
    }
  }
  if (rank(M.cast<Complex>()) != M.rows()) {
    throw SchemeRefusal(
        fmt::format("splitting needs as many equations of motion as there are fields with one, and M has rank {} on {} "
                    "fields{}",
                    rank(M.cast<Complex>()), M.rows(), splitting_remedy));
  }
  inverse_M_ = solve::quotient(M, MatrixXd::Identity(size(), size())).value();
}

/// A linear term c·x of S moves x by M⁻¹c at a constant rate. Where S'' has no constant entry of what is moved, the
/// waves can be kept from it, and the two flows commute.
void LinearWaves::find_translation() {
  slope_.assign(system_.fields().size(), 0.0);
  translation_.assign(evolving_.size(), 0.0);
  const std::vector<double> slopes = potential_slopes_at_zero(system_);
  for (int p = 0; p < size(); ++p) {
    const int f = evolving_[static_cast<std::size_t>(p)];
    const double slope = slopes[static_cast<std::size_t>(f)];
    if (is_in_rest(system_, f) || slope == 0.0 || !L_.row(f).isZero(0.0)) {
      continue;
    }
    std::vector<int> moved;
    for (int q = 0; q < size(); ++q) {
      if (inverse_M_(q, p) != 0.0) {
        moved.push_back(evolving_[static_cast<std::size_t>(q)]);
      }
    }
    const auto in_waves = [&](int g) {
      bool any = !system_.constant_hessian().row(g).isZero(0.0);
      for (int a = 0; a < grid_.dimensions(); ++a) {
        any = any || !system_.K(a).row(g).isZero(0.0);
      }
      return any;
    };
    if (std::ranges::any_of(moved, in_waves)) {
      continue;
    }
    slope_[static_cast<std::size_t>(f)] = slope;
    for (const int g : moved) {
      L_.row(g).setZero();
      L_.col(g).setZero();
    }
    for (int q = 0; q < size(); ++q) {
      translation_[static_cast<std::size_t>(q)] += inverse_M_(q, p) * slope;
    }
  }
}

/// Σ ik_a K_a, or what differences make of it: δ⁻ is -(δ⁺)ᵀ, with minus the conjugate symbol.
MatrixXcd LinearWaves::derivatives_on_wave(std::size_t wave) const {
  const auto k = fourier_.wave(wave);
  MatrixXcd sum = MatrixXcd::Zero(system_.field_count(), system_.field_count());
  for (int a = 0; a < grid_.dimensions(); ++a) {
    const grids::Axis& axis = grids::whole_of(grid_).axis(a);
    const auto number = k[static_cast<std::size_t>(a)];
    if (collocation_ == Collocation::nodes) {
      sum += grids::derivative_symbol(number, axis) * system_.K(a).cast<Complex>();
    } else {
      const double theta = 2.0 * std::numbers::pi * static_cast<double>(number) / static_cast<double>(axis.cells);
      const Complex forward = grids::difference_symbol(theta, axis.spacing());
      const MatrixXcd plus = system_.structure().K_plus[static_cast<std::size_t>(a)].cast<Complex>();
      sum += forward * plus + std::conj(forward) * plus.transpose();
    }
  }
  return sum;
}

/// With x the evolving fields and y the others, B = Σ ik_a K_a - L:  ŷ = -B₂₂⁻¹B₂₁ x̂,  M x̂_t = -(B₁₁ - B₁₂B₂₂⁻¹B₂₁) x̂.
void LinearWaves::reduce() {
  const Index r = size(), o = static_cast<Index>(others_.size());
  const std::size_t waves = fourier_.modes();
  energy_form_ = WaveRows(static_cast<int>(r * r), waves);
  slaves_ = WaveRows(static_cast<int>(o * r), waves);
  const auto part = [](const MatrixXcd& B, const std::vector<int>& rows, const std::vector<int>& columns) {
    MatrixXcd result(static_cast<Index>(rows.size()), static_cast<Index>(columns.size()));
    for (std::size_t i = 0; i < rows.size(); ++i) {
      for (std::size_t j = 0; j < columns.size(); ++j) {
        result(static_cast<Index>(i), static_cast<Index>(j)) = B(rows[i], columns[j]);
      }
    }
    return result;
  };
  constexpr std::ptrdiff_t none = std::numeric_limits<std::ptrdiff_t>::min();
  std::ptrdiff_t unsolved = none;  // the first wave that is
  for (std::size_t w = 0; w < waves; ++w) {
    const MatrixXcd B = derivatives_on_wave(w) - L_.cast<Complex>();
    MatrixXcd G = -part(B, evolving_, evolving_);
    if (o > 0) {
      const MatrixXcd B22 = part(B, others_, others_);
      const solve::Inverse inverse = solve::equilibrated_inverse_of(B22);
      if (!(inverse.smallest_pivot > 1e-12 * (1.0 + inverse.largest_pivot))) {
        unsolved = fourier_.wave(w)[0];
        break;
      }
      const MatrixXcd C = -solve::product(inverse.matrix, part(B, others_, evolving_));
      G -= solve::product(part(B, evolving_, others_), C);
      set_wave(C, w, slaves_);
    }
    set_wave(G, w, energy_form_);
  }
  if (const grids::Transposition* const shared = fourier_.transposition()) {  // all ranks refuse, or none
    const double largest = -std::numeric_limits<double>::max();
    const double wave =
        shared->slab().largest_over_ranks(unsolved == none ? largest : -std::abs(static_cast<double>(unsolved)));
    unsolved = wave == largest ? none : static_cast<std::ptrdiff_t>(-wave);
  }
  if (unsolved != none) {
    throw SchemeRefusal(
        fmt::format("splitting needs a linear part that can be solved for the fields without an equation of motion "
                    "({}, …) wave by wave, and on the wave number {} it cannot{}",
                    system_.fields()[static_cast<std::size_t>(others_.front())], unsolved, splitting_remedy));
  }
}

/// Of waves, those of other ranks as well.
double LinearWaves::largest(std::span<const double> values) const {
  const double here = largest_of_rows(values);
  const grids::Transposition* const shared = fourier_.transposition();
  return shared == nullptr ? here : shared->slab().largest_over_ranks(here);
}

double LinearWaves::sum_over_ranks(double here) const {
  const grids::Transposition* const shared = fourier_.transposition();
  return shared == nullptr ? here : shared->slab().sum_over_ranks(here);
}

Complex LinearWaves::generator(int row, int column, std::size_t wave) const {
  double re = 0.0, im = 0.0;
  for (int k = 0; k < size(); ++k) {
    if (const double factor = inverse_M_(row, k); factor != 0.0) {
      re += factor * energy_form_.re.field(k * size() + column)[wave];
      im += factor * energy_form_.im.field(k * size() + column)[wave];
    }
  }
  return {re, im};
}

void LinearWaves::group() {
  largest_generator_ = MatrixXd::Zero(size(), size());
  double largest_im = 0.0;
  for (int r = 0; r < size(); ++r) {
    for (int c = 0; c < size(); ++c) {
      double re = 0.0, im = 0.0;
      for (std::size_t w = 0; w < count(); ++w) {
        const Complex entry = generator(r, c, w);
        re = std::max(re, std::abs(entry.real()));
        im = std::max(im, std::abs(entry.imag()));
      }
      re = largest(std::array{re});
      im = largest(std::array{im});
      largest_generator_(r, c) = std::max(re, im);
      largest_im = std::max(largest_im, im);
    }
  }
  std::vector<int> group(static_cast<std::size_t>(size()));
  std::iota(group.begin(), group.end(), 0);
  for (int r = 0; r < size(); ++r) {
    for (int c = 0; c < size(); ++c) {
      const bool any = largest_generator_(r, c) > 0.0;
      const int from = group[static_cast<std::size_t>(c)], to = group[static_cast<std::size_t>(r)];
      if (any && from != to) {
        std::ranges::replace(group, from, to);
      }
    }
  }
  for (int g = 0; g < size(); ++g) {
    std::vector<int> members;
    for (int f = 0; f < size(); ++f) {
      if (group[static_cast<std::size_t>(f)] == g) {
        members.push_back(f);
      }
    }
    for (const int a : members) {
      for (const int b : members) {
        coupled_.emplace_back(a, b);
      }
    }
    if (!members.empty()) {
      groups_.push_back(std::move(members));
    }
  }
  real_pairs_ = largest_im == 0.0 && std::ranges::all_of(groups_, [](const auto& one) { return one.size() <= 2; });
}

/// Wave equations and Schrödinger's have real A and G: half of the work, and G is symmetric.
void LinearWaves::find_real_forms() {
  bool is_real = true;
  for (int row = 0; row < size(); ++row) {
    for (int column = 0; column < size(); ++column) {
      const int entry = row * size() + column;
      const double re = largest(std::as_const(energy_form_.re).field(entry)),
                   im = largest(std::as_const(energy_form_.im).field(entry));
      if (re > 0.0 || im > 0.0) {
        forms_.emplace_back(row, column);
      }
      is_real = is_real && im == 0.0;
    }
  }
  if (is_real) {
    std::ranges::copy_if(forms_, std::back_inserter(real_forms_),
                         [](const auto& form) { return form.first <= form.second; });
  }
}

/// out = matrix·in, over the coupled pairs.
void LinearWaves::multiply(const WaveRows& matrix, const WaveRows& in, WaveRows& out) const {
  for_each_wave_block(in.waves(), [&](std::size_t begin, std::size_t end) {
    for (int p = 0; p < size(); ++p) {
      std::fill(out.re.pointers()[static_cast<std::size_t>(p)] + begin,
                out.re.pointers()[static_cast<std::size_t>(p)] + end, 0.0);
      std::fill(out.im.pointers()[static_cast<std::size_t>(p)] + begin,
                out.im.pointers()[static_cast<std::size_t>(p)] + end, 0.0);
    }
    for (const auto& [row, column] : coupled_) {
      const int entry = row * size() + column;
      add_product(matrix.re.field(entry).data() + begin, matrix.im.field(entry).data() + begin,
                  in.re.field(column).data() + begin, in.im.field(column).data() + begin, end - begin,
                  out.re.pointers()[static_cast<std::size_t>(row)] + begin,
                  out.im.pointers()[static_cast<std::size_t>(row)] + begin);
    }
  });
}

void LinearWaves::rates(const WaveRows& in, WaveRows& out) const {
  for_each_wave_block(in.waves(), [&](std::size_t begin, std::size_t end) {
    WaveBlock slope;
    for (int p = 0; p < size(); ++p) {
      std::fill(out.re.pointers()[static_cast<std::size_t>(p)] + begin,
                out.re.pointers()[static_cast<std::size_t>(p)] + end, 0.0);
      std::fill(out.im.pointers()[static_cast<std::size_t>(p)] + begin,
                out.im.pointers()[static_cast<std::size_t>(p)] + end, 0.0);
    }
    for (int row = 0; row < size(); ++row) {
      slope.clear(end - begin);
      for (const auto& [form_row, column] : forms_) {
        if (form_row == row) {
          const int entry = row * size() + column;
          add_product(energy_form_.re.field(entry).data() + begin, energy_form_.im.field(entry).data() + begin,
                      in.re.field(column).data() + begin, in.im.field(column).data() + begin, end - begin, slope.re,
                      slope.im);
        }
      }
      for (int p = 0; p < size(); ++p) {
        if (const double factor = inverse_M_(p, row); factor != 0.0) {
          add(factor, slope.re, slope.im, end - begin, out.re.pointers()[static_cast<std::size_t>(p)] + begin,
              out.im.pointers()[static_cast<std::size_t>(p)] + begin);
        }
      }
    }
  });
}

/// X_1.
double LinearWaves::energy(const WaveRows& rows) const {
  CompensatedSum sum = sum_of_pieces(rows.waves(), [&](std::size_t begin, std::size_t end, CompensatedSum& into) {
    alignas(64) std::array<double, wave_block> terms;
    for (std::size_t first = begin; first < end; first += wave_block) {
      const std::size_t count = std::min(wave_block, end - first);
      for (std::size_t f = 0; f < real_forms_.size(); ++f) {
        const auto [row, column] = real_forms_[f];
        into.add((row == column ? 0.5 : 1.0) *
                 sum_form(parseval_.data() + first, energy_form_.re.field(row * size() + column).data() + first,
                          rows.re.field(row).data() + first, rows.im.field(row).data() + first,
                          rows.re.field(column).data() + first, rows.im.field(column).data() + first, count));
      }
      if (!real_forms_.empty()) {
        continue;
      }
      terms.fill(0.0);
      for (const auto& [row, column] : forms_) {
        const int entry = row * size() + column;
        const double* g_re = energy_form_.re.field(entry).data() + first;
        const double* g_im = energy_form_.im.field(entry).data() + first;
        const double* l_re = rows.re.field(row).data() + first;
        const double* l_im = rows.im.field(row).data() + first;
        const double* r_re = rows.re.field(column).data() + first;
        const double* r_im = rows.im.field(column).data() + first;
        add_form(g_re, g_im, l_re, l_im, r_re, r_im, count, terms.data());
      }
      into.add(weighted_sum(parseval_.data() + first, terms.data(), count));
    }
  });
  for (int p = 0; p < size(); ++p) {
    const double slope = slope_[static_cast<std::size_t>(evolving_[static_cast<std::size_t>(p)])];
    if (slope != 0.0 && has_mean_) {
      sum.add(slope * rows.re.field(p)[0]);  // Σ x over the nodes
    }
  }
  return grid_.cell_volume() * sum_over_ranks(sum.value());
}

}  // namespace rubato
