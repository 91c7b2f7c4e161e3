#include <rubato/pde/twists.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>
#include <Eigen/Core>

#include <rubato/solve/spectrum.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;

/// Eigenvalues of a rotation that are closer than this, relative to the largest, are one; so small a one is 0.
constexpr double same_frequency = 1e-7;

/// The distinct |Im λ| of G, ascending, 0 among them where it is one.
std::vector<double> all_frequencies(const MatrixXd& G) {
  const Eigen::VectorXcd values = solve::eigenvectors(G).values;
  const double largest = values.cwiseAbs().maxCoeff();
  std::vector<double> sizes;
  for (const std::complex<double> value : values) {
    sizes.push_back(std::abs(value.imag()) > same_frequency * largest ? std::abs(value.imag()) : 0.0);
  }
  std::ranges::sort(sizes);
  std::vector<double> result;
  for (std::size_t i = 0; i < sizes.size();) {
    double sum = 0.0;
    std::size_t count = 0;
    for (const double first = sizes[i]; i < sizes.size() && sizes[i] - first <= same_frequency * largest; ++i) {
      sum += sizes[i];
      ++count;
    }
    result.push_back(sum / static_cast<double>(count));
  }
  return result;
}

}  // namespace

Rotation::Rotation(const MatrixXd& G) : still_(MatrixXd::Zero(G.rows(), G.cols())) {
  const MatrixXd square = G.lazyProduct(G), one = MatrixXd::Identity(G.rows(), G.cols());
  const std::vector<double> all = all_frequencies(G);
  MatrixXd sum = MatrixXd::Zero(G.rows(), G.cols()), generator = sum;
  for (const double frequency : all) {
    MatrixXd projection = one;
    for (const double other : all) {
      if (other != frequency) {
        const double distance = other * other - frequency * frequency;
        projection = MatrixXd(projection.lazyProduct((square + other * other * one) / distance));
      }
    }
    sum += projection;
    if (frequency == 0.0) {
      still_ = projection;
      continue;
    }
    frequencies_.push_back(frequency);
    cosine_.push_back(projection);
    sine_.emplace_back(G.lazyProduct(projection) / frequency);
    generator += frequency * sine_.back();
  }
  constexpr double no_rounding = 1e-10;
  const double size = G.cwiseAbs().maxCoeff();
  if (!((sum - one).cwiseAbs().maxCoeff() <= no_rounding) ||
      !((generator - G).cwiseAbs().maxCoeff() <= no_rounding * size)) {
    throw std::invalid_argument("it is no rotation: exp(s B) grows with s");
  }
}

MatrixXd Rotation::operator()(double d) const {
  MatrixXd result = still_;
  for (std::size_t i = 0; i < frequencies_.size(); ++i) {
    result += std::cos(frequencies_[i] * d) * cosine_[i] + std::sin(frequencies_[i] * d) * sine_[i];
  }
  return result;
}

std::vector<formula::Expression> Rotation::row(Index row, formula::Expression d, formula::Graph& graph) const {
  std::vector<formula::Expression> entries;
  for (Index column = 0; column < still_.cols(); ++column) {
    formula::Expression sum = graph.constant(still_(row, column));
    for (std::size_t i = 0; i < frequencies_.size(); ++i) {
      const auto add = [&](double factor, const auto& function) {
        if (factor != 0.0) {
          sum = sum + factor * function(frequencies_[i] * d);
        }
      };
      add(cosine_[i](row, column), [](formula::Expression angle) { return cos(angle); });
      add(sine_[i](row, column), [](formula::Expression angle) { return sin(angle); });
    }
    entries.push_back(sum);
  }
  return entries;
}

Twists::Twists(std::vector<grids::Axis> axes, std::vector<MatrixXd> rates) : axes_(std::move(axes)) {
  if (std::ranges::all_of(rates, [](const MatrixXd& G) { return G.isZero(0.0); })) {
    return;
  }
  for (const MatrixXd& G : rates) {
    rotations_.emplace_back(G);
  }
  rates_ = std::move(rates);
}

std::vector<int> mixed_fields(const std::vector<MatrixXd>& G, int field) {
  std::vector<int> found = {field};
  for (std::size_t i = 0; i < found.size(); ++i) {
    for (const MatrixXd& matrix : G) {
      for (Index g = 0; g < matrix.cols(); ++g) {
        const bool mixed = matrix(found[i], g) != 0.0 || matrix(g, found[i]) != 0.0;
        if (mixed && std::ranges::find(found, static_cast<int>(g)) == found.end()) {
          found.push_back(static_cast<int>(g));
        }
      }
    }
  }
  return found;
}

formula::Expression Twists::quadratic(const MultisymplecticSystem& system) const {
  formula::Expression sum = system.graph()->constant(0.0);
  for (std::size_t a = 0; a < rates_.size(); ++a) {
    const MatrixXd KG = system.K(static_cast<int>(a)).lazyProduct(rates_[a]);
    for (Index i = 0; i < KG.rows(); ++i) {
      for (Index j = 0; j <= i; ++j) {
        // KG is symmetric but for rounding.
        if (const double entry = 0.5 * (KG(i, j) + KG(j, i)); entry != 0.0) {
          sum = sum + (i == j ? 0.5 : 1.0) * entry * system.variables()[static_cast<std::size_t>(i)] *
                          system.variables()[static_cast<std::size_t>(j)];
        }
      }
    }
  }
  return sum;
}

MatrixXd Twists::turn(std::span<const double> d) const {
  MatrixXd result = rotations_.front()(d.front());
  for (std::size_t a = 1; a < rotations_.size(); ++a) {
    result = MatrixXd(result.lazyProduct(rotations_[a](d[a])));
  }
  return result;
}

std::vector<formula::Expression> Twists::row(int field, std::span<const formula::Expression> d,
                                             formula::Graph& graph) const {
  const auto size = static_cast<std::size_t>(rates_.front().cols());
  std::vector<formula::Expression> result(size, graph.constant(0.0));
  result[static_cast<std::size_t>(field)] = graph.constant(1.0);
  for (std::size_t a = 0; a < rotations_.size(); ++a) {
    if (rates_[a].isZero(0.0) || !d[a].valid()) {
      continue;
    }
    std::vector<formula::Expression> product(size, graph.constant(0.0));
    for (std::size_t g = 0; g < size; ++g) {
      const std::vector<formula::Expression> other = rotations_[a].row(static_cast<Index>(g), d[a], graph);
      for (std::size_t k = 0; k < size; ++k) {
        product[k] = product[k] + result[g] * other[k];
      }
    }
    result = std::move(product);
  }
  return result;
}

std::vector<formula::Expression> Twists::row(int field, formula::Graph& graph) const {
  std::vector<formula::Expression> distances;
  for (const grids::Axis& axis : axes_) {
    distances.push_back(graph.variable(axis.name) - axis.from);
  }
  return row(field, distances, graph);
}

void Twists::apply(bool inverse, int field, const grids::Grid& grid, std::span<const double> all,
                   std::span<double> out) const {
  std::vector<std::size_t> turning;
  std::vector<std::vector<MatrixXd>> along;  // of each turning axis, at its nodes
  for (std::size_t a = 0; a < rates_.size(); ++a) {
    if (rates_[a].isZero(0.0)) {
      continue;
    }
    const grids::Axis& axis = grid.axis(static_cast<int>(a));
    turning.push_back(a);
    auto& matrices = along.emplace_back();
    for (std::size_t i = 0; i < axis.cells; ++i) {
      const double distance = axis.node(i) - axes_[a].from;
      matrices.push_back(rotations_[a](inverse ? -distance : distance));
    }
  }
  const std::size_t size = grid.size();
  for (std::size_t node = 0; node < size; ++node) {
    Eigen::RowVectorXd row = Eigen::RowVectorXd::Unit(rates_.front().cols(), field);
    for (std::size_t t = 0; t < turning.size(); ++t) {
      const int axis = static_cast<int>(turning[t]);
      const MatrixXd& turn = along[t][node / grid.stride(axis) % grid.cells(axis)];
      row = t == 0 ? Eigen::RowVectorXd(turn.row(field)) : Eigen::RowVectorXd(row.lazyProduct(turn));
    }
    double sum = 0.0;
    for (Index g = 0; g < row.cols(); ++g) {
      sum += row(g) == 0.0 ? 0.0 : row(g) * all[static_cast<std::size_t>(g) * size + node];
    }
    out[node] = sum;
  }
}

}  // namespace rubato
