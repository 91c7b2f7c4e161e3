#include <rubato/pde/jumps.hpp>

#include <algorithm>
#include <array>
#include <utility>

#include <fmt/format.h>
#include <Eigen/Dense>

#include <rubato/formula/batch.hpp>
#include <rubato/grids/resample.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

/// The algebraic fields whose rows of ∇S are linear, with constants, in such fields alone.
std::vector<Eigen::Index> linear_algebraic_fields(const MultisymplecticSystem& system) {
  const auto d = static_cast<std::size_t>(system.field_count());
  const FieldStructure& structure = system.structure();
  std::vector<bool> keeps(d);
  for (std::size_t f = 0; f < d; ++f) {
    const int field = static_cast<int>(f);
    keeps[f] = structure.algebraic[f] && !structure.at_midpoints(field) && !system.varies_in_space(field);
  }
  for (const auto [row, column] : system.varying_hessian()) {
    keeps[static_cast<std::size_t>(row)] = keeps[static_cast<std::size_t>(column)] = false;
  }
  for (bool again = true; again;) {
    again = false;
    for (std::size_t f = 0; f < d; ++f) {
      for (std::size_t g = 0; g < d && keeps[f]; ++g) {
        const bool coupled =
            system.constant_hessian()(static_cast<Eigen::Index>(f), static_cast<Eigen::Index>(g)) != 0.0;
        if (coupled && !keeps[g]) {
          keeps[f] = false;
          again = true;
        }
      }
    }
  }
  std::vector<Eigen::Index> fields;
  for (std::size_t f = 0; f < d; ++f) {
    if (keeps[f]) {
      fields.push_back(static_cast<Eigen::Index>(f));
    }
  }
  return fields;
}

}  // namespace

Jumps::Jumps(const MultisymplecticSystem& laboratory, const std::vector<grids::Axis>& axes,
             const std::vector<Eigen::VectorXd>& jumps)
    : axes_(axes) {
  const Eigen::Index d = laboratory.field_count();
  mean_ = linear_ = Eigen::VectorXd::Zero(d);
  for (std::size_t a = 0; a < axes.size(); ++a) {
    slopes_.emplace_back(jumps[a] / axes[a].length());
    linear_ += laboratory.K(static_cast<int>(a)).lazyProduct(slopes_.back());
  }
  const std::vector<Eigen::Index> fields = linear_algebraic_fields(laboratory);
  if (fields.empty()) {
    return;
  }
  const Eigen::MatrixXd H = laboratory.constant_hessian()(fields, fields);
  const Eigen::VectorXd right = linear_(fields);
  const Eigen::VectorXd mean = H.completeOrthogonalDecomposition().solve(right);
  if (!((H.lazyProduct(mean) - right).norm() <= 1e-12 * right.norm())) {
    return;
  }
  mean_(fields) = mean;
  linear_(fields).setZero();
  // S(z + c) = S(z) + c·∇S(z) + ½ cᵀS''c, and of c·∇S what is not linear in z is its value where these fields are 0.
  std::vector<double> point(laboratory.variables().size(), 0.5), outputs(static_cast<std::size_t>(d) + 1);
  for (const Eigen::Index f : fields) {
    point[static_cast<std::size_t>(f)] = 0.0;
  }
  formula::ScalarEvaluator(laboratory.gradient_code())(point, outputs);
  for (const Eigen::Index f : fields) {
    constant_ += mean_(f) * outputs[static_cast<std::size_t>(f) + 1];
  }
  constant_ += 0.5 * mean.dot(H.lazyProduct(mean));
  for (std::size_t a = 0; a < slopes_.size(); ++a) {
    constant_ += slopes_[a].dot(laboratory.structure().K_plus[a].lazyProduct(mean_));
  }
}

bool Jumps::has(int field) const {
  return any() && (mean_(field) != 0.0 || std::ranges::any_of(slopes_, [&](const auto& s) { return s(field) != 0.0; }));
}

formula::Expression Jumps::ramp(int field, formula::Graph& graph) const {
  formula::Expression sum = graph.constant(mean_(field));
  for (std::size_t a = 0; a < axes_.size(); ++a) {
    if (slopes_[a](field) != 0.0) {
      sum = sum + slopes_[a](field) * (graph.variable(axes_[a].name) - axes_[a].from);
    }
  }
  return sum;
}

MultisymplecticSystem Jumps::seen(const MultisymplecticSystem& laboratory) const {
  if (!any()) {
    return laboratory;
  }
  formula::Graph& graph = *laboratory.graph();
  const std::span<const formula::Expression> z(laboratory.variables().data(), laboratory.fields().size());
  std::vector<formula::Expression> with_ramps;
  formula::Expression linear = graph.constant(constant_);
  for (int f = 0; f < laboratory.field_count(); ++f) {
    const formula::Expression field = z[static_cast<std::size_t>(f)];
    // What c does to S is in `linear` and in constant_.
    const bool jumps = std::ranges::any_of(slopes_, [&](const auto& s) { return s(f) != 0.0; });
    with_ramps.push_back(jumps ? field + ramp(f, graph) : field);
    if (linear_(f) != 0.0) {
      linear = linear - linear_(f) * field;
    }
  }
  std::vector<formula::Expression> parts{laboratory.expression()};
  for (int a = 0; a < laboratory.directions(); ++a) {
    const auto& places = laboratory.coordinates();
    const auto at = std::ranges::find(places, a);
    parts.push_back(at == places.end() ? graph.constant(0.0)
                                       : laboratory.sources()[static_cast<std::size_t>(at - places.begin())]);
  }
  parts = formula::substitute(parts, graph, z, with_ramps);
  MultisymplecticSystem::Ramps ramps{slopes_, {parts.begin() + 1, parts.end()}};
  std::vector<Eigen::MatrixXd> K;
  for (int a = 0; a < laboratory.directions(); ++a) {
    K.push_back(laboratory.K(a));
  }
  return {laboratory.graph(), laboratory.fields(),    laboratory.M(),
          std::move(K),       parts.front() + linear, std::move(ramps)};
}

CornerDensity Jumps::seen(CornerDensity density) const {
  if (!any()) {
    return density;
  }
  std::vector<formula::Expression> from, to;
  for (int f = 0; f < density.fields; ++f) {
    for (int number = 0; has(f) && number < density.corner_count(); ++number) {
      const formula::Expression corner = density.corner(f, number);
      formula::Expression sum = corner + mean_(f);
      for (std::size_t a = 0; a < slopes_.size(); ++a) {
        if (const double slope = slopes_[a](f); slope != 0.0) {
          const formula::Expression lower = density.places[a] - axes_[a].from;
          sum = sum + slope * ((number >> a & 1) != 0 ? lower + density.spacings[1 + a] : lower);
        }
      }
      from.push_back(corner);
      to.push_back(sum);
    }
  }
  density.L = formula::substitute(std::array{density.L}, *density.graph, from, to).front();
  return density;
}

std::vector<formula::Expression> Jumps::seen(const std::vector<formula::Expression>& formulas, formula::Graph& graph,
                                             const std::vector<std::string>& fields) const {
  std::vector<formula::Expression> from, to;
  for (std::size_t f = 0; f < fields.size(); ++f) {
    const int field = static_cast<int>(f);
    if (!has(field)) {
      continue;
    }
    from.push_back(graph.variable(fields[f]));
    to.push_back(from.back() + ramp(field, graph));
    for (std::size_t a = 0; a < axes_.size(); ++a) {
      if (slopes_[a](field) != 0.0) {
        from.push_back(graph.variable(fmt::format("d{}({})", axes_[a].name, fields[f])));
        to.push_back(from.back() + slopes_[a](field));
      }
    }
  }
  return from.empty() ? formulas : formula::substitute(formulas, graph, from, to);
}

std::vector<double> Jumps::ramp(int field, const grids::Grid& grid) const {
  std::vector<double> values;
  if (!has(field)) {
    return values;
  }
  values.assign(grid.size(), mean_(field));
  for (std::size_t a = 0; a < slopes_.size(); ++a) {
    const grids::Axis& axis = grid.axis(static_cast<int>(a));
    const std::size_t stride = grid.stride(static_cast<int>(a));
    for (std::size_t i = 0; i < values.size() && slopes_[a](field) != 0.0; ++i) {
      values[i] += slopes_[a](field) * (axis.node(i / stride % axis.cells) - axes_[a].from);
    }
  }
  return values;
}

void Jumps::add(int field, const grids::Grid& grid, std::span<double> values) const {
  std::ranges::transform(ramp(field, grid), values, values.begin(), std::plus<>());
}

void Jumps::subtract(int field, const grids::Grid& grid, std::span<double> values) const {
  std::ranges::transform(values, ramp(field, grid), values.begin(), std::minus<>());
}

std::vector<double> Jumps::resampled(int field, std::vector<double> values, const grids::Grid& from,
                                     const grids::Grid& to) const {
  const bool same = std::ranges::equal(from.axes(), to.axes(), {}, &grids::Axis::cells, &grids::Axis::cells);
  if (same || !has(field)) {
    return grids::resampled(values, from, to);  // which leaves the bits of the same cells alone
  }
  subtract(field, from, values);
  std::vector<double> result = grids::resampled(values, from, to);
  add(field, to, result);
  return result;
}

WithRamps::WithRamps(const Jumps& jumps, const grids::Grid& grid, int fields) {
  for (int f = 0; f < fields; ++f) {
    ramps_.push_back(jumps.ramp(f, grid));
  }
}

std::span<const double> WithRamps::operator()(int field, std::span<const double> values) {
  const std::vector<double>& ramp = ramps_[static_cast<std::size_t>(field)];
  if (ramp.empty()) {
    return values;
  }
  sum_.resize(values.size());
  std::ranges::transform(values, ramp, sum_.begin(), std::plus<>());
  return sum_;
}

void WithRamps::remove(int field, std::span<double> values) const {
  const std::vector<double>& ramp = ramps_[static_cast<std::size_t>(field)];
  if (!ramp.empty()) {
    std::ranges::transform(values, ramp, values.begin(), std::minus<>());
  }
}

}  // namespace rubato
