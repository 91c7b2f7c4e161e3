#include <rubato/pde/static_condensation.hpp>

#include <algorithm>

#include <rubato/formula/batch.hpp>

namespace rubato {

bool in_no_K(const MultisymplecticSystem& system, int field) {
  for (int a = 0; a < system.directions(); ++a) {
    if (!system.K(a).row(field).isZero(0.0)) {
      return false;
    }
  }
  return true;
}

std::optional<LinearRow> linear_row(const MultisymplecticSystem& system, int field) {
  const auto& varying = system.varying_hessian();
  const Eigen::MatrixXd& hessian = system.constant_hessian();
  if (system.varies_in_space(field) || hessian(field, field) == 0.0 ||
      (hessian.row(field).array() != 0.0).count() != 1 ||
      std::ranges::any_of(varying, [&](const HessianEntry& e) { return e.row == field || e.column == field; })) {
    return std::nullopt;
  }
  const std::vector<double> ones(system.variables().size(), 1.0);
  std::vector<double> outputs(system.fields().size() + 1);
  formula::ScalarEvaluator(system.gradient_code())(ones, outputs);
  const double a = hessian(field, field);
  return LinearRow{a, outputs[1 + static_cast<std::size_t>(field)] - a};  // ∂S/∂s depends on s alone
}

StaticCondensation::StaticCondensation(const MultisymplecticSystem& system, std::nullptr_t) : system_(system) {
  for (int f = 0; f < system.field_count(); ++f) {
    free_.push_back(f);
  }
}

StaticCondensation::StaticCondensation(const MultisymplecticSystem& system) : system_(system) {
  std::vector<bool> condensed(system.fields().size(), false);
  for (int f = 0; f < system.field_count(); ++f) {
    const auto masters_evolve = [&] {
      for (int j = 0; j < system.field_count(); ++j) {
        if (system.M()(f, j) != 0.0 && (condensed[static_cast<std::size_t>(j)] || system.structure().at_midpoints(j))) {
          return false;
        }
      }
      return true;
    };
    const std::optional<LinearRow> row = linear_row(system, f);
    if (system.structure().at_midpoints(f) || !in_no_K(system, f) || !row || !masters_evolve()) {
      continue;
    }
    condensed[static_cast<std::size_t>(f)] = true;
    Slave slave{f, *row, {}};
    for (int j = 0; j < system.field_count(); ++j) {
      if (system.M()(f, j) != 0.0) {
        slave.masters.emplace_back(j, system.M()(f, j));
      }
    }
    slaves_.push_back(std::move(slave));
  }
  for (int f = 0; f < system.field_count(); ++f) {
    if (!condensed[static_cast<std::size_t>(f)]) {
      free_.push_back(f);
    }
  }
}

Eigen::MatrixXd StaticCondensation::restricted(const Eigen::MatrixXd& matrix) const {
  return matrix(free_, free_);
}

void StaticCondensation::reduced_mean(double h, Eigen::MatrixXd& reduced) const {
  constexpr int most = MultisymplecticSystem::most_fields;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, most, most> mean =
      (2.0 / h) * system_.M() - system_.constant_hessian();
  for (const Slave& slave : slaves_) {
    const Eigen::Matrix<double, 1, Eigen::Dynamic, Eigen::RowMajor, 1, most> row =
        mean.row(slave.field) / mean(slave.field, slave.field);
    const Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, most, 1> column = mean.col(slave.field);
    mean.noalias() -= column * row;
  }
  const auto size = static_cast<Eigen::Index>(free_.size());
  reduced.resize(size, size);
  for (Eigen::Index r = 0; r < size; ++r) {
    for (Eigen::Index c = 0; c < size; ++c) {
      reduced(r, c) = mean(free_[static_cast<std::size_t>(r)], free_[static_cast<std::size_t>(c)]);
    }
  }
}

int StaticCondensation::place(int field) const {
  return static_cast<int>(std::ranges::find(free_, field) - free_.begin());
}

void StaticCondensation::follow(double h, const grids::FieldSet& high, const grids::FieldSet& low,
                                grids::FieldSet& delta) const {
  for (const Slave& slave : slaves_) {
    const double constant = -slave.row.b / slave.row.a;
    const double* z = high.field(slave.field).data();
    const double* rest = low.field(slave.field).data();
    double* out = delta.field(slave.field).data();
    grids::for_each_block(delta.size(), grids::nodes_per_block, [&, z, rest, out](std::size_t begin, std::size_t end) {
      std::fill(out + begin, out + end, constant);
      for (const auto& [field, entry] : slave.masters) {
        const double factor = entry / (h * slave.row.a);
        const double* in = delta.field(field).data();
        for (std::size_t i = begin; i < end; ++i) {
          out[i] += factor * in[i];
        }
      }
      for (std::size_t i = begin; i < end; ++i) {
        out[i] = 2.0 * ((out[i] - z[i]) - rest[i]);
      }
    });
  }
}

void StaticCondensation::correct(double h, grids::FieldSet& correction) const {
  for (const Slave& slave : slaves_) {
    double* out = correction.field(slave.field).data();
    grids::for_each_block(correction.size(), grids::nodes_per_block, [&, out](std::size_t begin, std::size_t end) {
      std::fill(out + begin, out + end, 0.0);
      for (const auto& [field, entry] : slave.masters) {
        const double factor = 2.0 * entry / (h * slave.row.a);
        const double* in = correction.field(field).data();
        for (std::size_t i = begin; i < end; ++i) {
          out[i] += factor * in[i];
        }
      }
    });
  }
}

}  // namespace rubato
