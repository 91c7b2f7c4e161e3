#include <rubato/pde/jumps.hpp>

#include <algorithm>
#include <array>
#include <set>
#include <stdexcept>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <Eigen/Core>

#include <rubato/formula/batch.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/resample.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

/// The axes, from the outermost to the innermost, and the field of dx(dy(f)).
std::pair<std::string, std::string> derivative_of(std::string_view name) {
  std::string axes;
  while (name.size() > 4 && name[0] == 'd' && name[2] == '(' && name.back() == ')') {
    axes += name[1];
    name = name.substr(3, name.size() - 4);
  }
  return {axes, std::string(name)};
}

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
             const std::vector<Eigen::VectorXd>& jumps, Twists twists)
    : axes_(axes), twists_(std::move(twists)) {
  const Eigen::Index d = laboratory.field_count();
  mean_ = linear_ = Eigen::VectorXd::Zero(d);
  for (std::size_t a = 0; a < jumps.size(); ++a) {
    slopes_.emplace_back(jumps[a] / axes[a].length());
    linear_ += laboratory.K(static_cast<int>(a)).lazyProduct(slopes_.back());
  }
  if (!slopes_.empty()) {
    find_mean(laboratory);
  }
  for (int f = 0; f < laboratory.field_count(); ++f) {
    if (has_ramp(f) && twists_.partners(f).size() > 1) {
      throw std::invalid_argument(
          fmt::format("{} turns from one period to the next, and jumps, or follows from a field that does",
                      laboratory.fields()[static_cast<std::size_t>(f)]));
    }
  }
}

void Jumps::find_mean(const MultisymplecticSystem& laboratory) {
  const Eigen::Index d = laboratory.field_count();
  const std::vector<Eigen::Index> fields = linear_algebraic_fields(laboratory);
  if (fields.empty()) {
    return;
  }
  const Eigen::MatrixXd H = laboratory.constant_hessian()(fields, fields);
  const Eigen::VectorXd right = linear_(fields);
  const Eigen::VectorXd mean = solve::least_squares(H, right);
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

bool Jumps::has_ramp(int field) const {
  return !slopes_.empty() &&
         (mean_(field) != 0.0 || std::ranges::any_of(slopes_, [&](const auto& s) { return s(field) != 0.0; }));
}

formula::Expression Jumps::ramp(int field, formula::Graph& graph) const {
  formula::Expression sum = graph.constant(mean_(field));
  for (std::size_t a = 0; a < slopes_.size(); ++a) {
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
  MultisymplecticSystem::Ramps ramps{
      .slopes = slopes_, .sources = {parts.begin() + 1, parts.end()}, .turns = twists_.rates()};
  std::vector<Eigen::MatrixXd> K;
  for (int a = 0; a < laboratory.directions(); ++a) {
    K.push_back(laboratory.K(a));
  }
  return {laboratory.graph(),
          laboratory.fields(),
          laboratory.M(),
          std::move(K),
          parts.front() + linear - twists_.quadratic(laboratory),
          std::move(ramps)};
}

CornerDensity Jumps::seen(CornerDensity density) const {
  if (!any()) {
    return density;
  }
  std::vector<formula::Expression> from, to;
  for (int number = 0; number < density.corner_count(); ++number) {
    // L is the same where all corners turn together, so that the lower node need not turn.
    std::vector<formula::Expression> distances(axes_.size());
    for (std::size_t a = 0; a < axes_.size(); ++a) {
      if ((number >> a & 1) != 0) {
        distances[a] = density.spacings[1 + a];
      }
    }
    for (int f = 0; f < density.fields; ++f) {
      if (!has(f)) {
        continue;
      }
      formula::Expression sum = density.corner(f, number);
      if (partners(f).size() > 1) {
        sum = density.graph->constant(0.0);
        const std::vector<formula::Expression> turn = twists_.row(f, distances, *density.graph);
        for (const int g : partners(f)) {
          sum = sum + turn[static_cast<std::size_t>(g)] * density.corner(g, number);
        }
      } else {
        sum = sum + mean_(f);
      }
      for (std::size_t a = 0; a < slopes_.size(); ++a) {
        if (const double slope = slopes_[a](f); slope != 0.0) {
          const formula::Expression lower = density.places[a] - axes_[a].from;
          sum = sum + slope * ((number >> a & 1) != 0 ? lower + density.spacings[1 + a] : lower);
        }
      }
      from.push_back(density.corner(f, number));
      to.push_back(sum);
    }
  }
  density.L = formula::substitute(std::array{density.L}, *density.graph, from, to).front();
  return density;
}

/// D_a … z_f, the axes from the outermost to the innermost: of R z~ it is R Π(D_a + G_a) z~, and of a ramp its slope.
formula::Expression Jumps::whole(int field, const std::string& axes, formula::Graph& graph,
                                 const std::vector<std::string>& fields) const {
  formula::Expression sum = graph.constant(0.0);
  if (has_ramp(field)) {
    const auto at = std::ranges::find(axes_, axes.substr(0, 1), &grids::Axis::name);
    sum = axes.empty()       ? ramp(field, graph)
          : axes.size() == 1 ? graph.constant(slopes_[static_cast<std::size_t>(at - axes_.begin())](field))
                             : sum;
  }
  const auto derivative = [&](const std::string& of, std::size_t g) {
    std::string name = fields[g];
    for (auto axis = of.rbegin(); axis != of.rend(); ++axis) {
      name = fmt::format("d{}({})", *axis, name);
    }
    return graph.variable(name);
  };
  if (partners(field).size() == 1) {
    return sum + derivative(axes, static_cast<std::size_t>(field));
  }
  // The terms of the product: which derivatives are left, and the matrix before them.
  const Eigen::Index d = twists_.rates().front().cols();
  std::vector<std::pair<std::string, Eigen::MatrixXd>> terms = {{"", Eigen::MatrixXd::Identity(d, d)}};
  for (const char axis : axes) {
    const auto a = std::ranges::find(axes_, std::string(1, axis), &grids::Axis::name) - axes_.begin();
    for (std::size_t i = 0, count = terms.size(); i < count; ++i) {
      terms.emplace_back(terms[i].first, terms[i].second.lazyProduct(twists_.rates()[static_cast<std::size_t>(a)]));
      terms[i].first += axis;
    }
  }
  const std::vector<formula::Expression> turn = twists_.row(field, graph);
  for (const auto& [left, matrix] : terms) {
    for (Eigen::Index i = 0; i < d; ++i) {
      for (Eigen::Index g = 0; g < d; ++g) {
        if (matrix(i, g) != 0.0) {
          sum = sum + turn[static_cast<std::size_t>(i)] * matrix(i, g) * derivative(left, static_cast<std::size_t>(g));
        }
      }
    }
  }
  return sum;
}

std::vector<formula::Expression> Jumps::seen(const std::vector<formula::Expression>& formulas, formula::Graph& graph,
                                             const std::vector<std::string>& fields) const {
  if (!any()) {
    return formulas;
  }
  std::set<std::string> names;
  for (const formula::Expression& one : formulas) {
    for (const std::size_t variable : formula::variables_of(one)) {
      names.insert(graph.variable_name(variable));
    }
  }
  std::vector<formula::Expression> from, to;
  for (const std::string& name : names) {
    const auto [axes, base] = derivative_of(name);
    const auto field = std::ranges::find(fields, base);
    if (field != fields.end() && has(static_cast<int>(field - fields.begin()))) {
      from.push_back(graph.variable(name));
      to.push_back(whole(static_cast<int>(field - fields.begin()), axes, graph, fields));
    }
  }
  return from.empty() ? formulas : formula::substitute(formulas, graph, from, to);
}

std::vector<double> Jumps::ramp(int field, const grids::Grid& grid) const {
  std::vector<double> values;
  if (!has_ramp(field)) {
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

std::vector<std::vector<double>> Jumps::resampled(const std::vector<int>& fields, const std::vector<FieldOnGrid>& given,
                                                  const grids::Grid& to) const {
  const auto same = [](const grids::Grid& a, const grids::Grid& b) {
    return std::ranges::equal(a.axes(), b.axes(), {}, &grids::Axis::cells, &grids::Axis::cells);
  };
  const auto place = [](auto& all, const grids::Grid& grid, int field) {
    return all.begin() + static_cast<std::ptrdiff_t>(grid.size()) * field;
  };
  std::vector<std::vector<double>> results;
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const auto& [values, grid] = given[i];
    if (same(grid, to)) {
      results.push_back(values);  // which leaves the bits of the same cells alone
      continue;
    }
    if (!has(fields[i])) {
      results.push_back(grids::resampled(values, grid, to));
      continue;
    }
    const auto count = static_cast<std::size_t>(mean_.size());
    std::vector<double> before(count * grid.size()), after(count * to.size());
    for (const int partner : partners(fields[i])) {
      const auto at = static_cast<std::size_t>(std::ranges::find(fields, partner) - fields.begin());
      if (at == fields.size() || !same(given[at].grid, grid)) {
        throw std::invalid_argument(
            "fields that turn together from one period to the next have to be given together, on the same nodes");
      }
      std::ranges::copy(given[at].values, place(before, grid, partner));
    }
    WholeFields(*this, grid, static_cast<int>(count)).remove(before);
    for (const int partner : partners(fields[i])) {
      const std::span<const double> periodic(place(before, grid, partner), grid.size());
      std::ranges::copy(grids::resampled(periodic, grid, to), place(after, to, partner));
    }
    WholeFields whole(*this, to, static_cast<int>(count));
    const std::span<const double> result = whole(fields[i], after);
    results.emplace_back(result.begin(), result.end());
  }
  return results;
}

WholeFields::WholeFields(const Jumps& jumps, const grids::Grid& grid, int fields) : jumps_(jumps), grid_(grid) {
  for (int f = 0; f < fields; ++f) {
    ramps_.push_back(jumps.ramp(f, grid));
    turns_.push_back(jumps.partners(f).size() > 1);
  }
}

std::span<const double> WholeFields::operator()(int field, std::span<const double> all) {
  const auto f = static_cast<std::size_t>(field);
  const std::size_t size = all.size() / ramps_.size();
  const std::span<const double> values = all.subspan(f * size, size);
  if (ramps_[f].empty() && !turns_[f]) {
    return values;
  }
  sum_.resize(size);
  if (turns_[f]) {
    jumps_.twists().apply(false, field, *grid_, all, sum_);
  } else {
    std::ranges::transform(values, ramps_[f], sum_.begin(), std::plus<>());
  }
  return sum_;
}

void WholeFields::remove(std::span<double> all, const std::function<bool(int)>& is_whole) const {
  const std::size_t size = all.size() / ramps_.size();
  const bool turns = std::ranges::find(turns_, true) != turns_.end();
  const std::vector<double> whole(turns ? all.begin() : all.end(), all.end());
  for (std::size_t f = 0; f < ramps_.size(); ++f) {
    const std::span<double> values = all.subspan(f * size, size);
    if (!is_whole(static_cast<int>(f))) {
      continue;
    }
    if (turns_[f]) {
      jumps_.twists().apply(true, static_cast<int>(f), *grid_, whole, values);
    } else if (!ramps_[f].empty()) {
      std::ranges::transform(values, ramps_[f], values.begin(), std::minus<>());
    }
  }
}

double WholeFields::largest_addend(int field, std::span<const double> all) const {
  const std::size_t size = all.size() / ramps_.size();
  double largest = grids::max_abs(ramps_[static_cast<std::size_t>(field)]);
  for (const int partner : jumps_.partners(field)) {
    if (partner != field) {
      largest = std::max(largest, grids::max_abs(all.subspan(static_cast<std::size_t>(partner) * size, size)));
    }
  }
  return largest;
}

}  // namespace rubato
