// What every solver of linear systems has to do, for all that solve/ and pde/ have: a test compares with their headers.

#include <omp.h>

#include <cmath>
#include <complex>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Dense>
#include <catch2/catch.hpp>

#include <rubato/grids/field_set.hpp>
#include <rubato/grids/stencil.hpp>
#include <rubato/pde/cell_solver.hpp>
#include <rubato/pde/wave_resolvent.hpp>
#include <rubato/solve/band_solver.hpp>
#include <rubato/solve/cyclic_block.hpp>
#include <rubato/solve/cyclic_sparse.hpp>
#include <rubato/solve/dense_solver.hpp>
#include <rubato/solve/elimination.hpp>
#include <rubato/solve/fourier_preconditioner.hpp>
#include <rubato/solve/gmres.hpp>
#include <rubato/solve/small_matrices.hpp>
#include <rubato/solve/sparse_factors.hpp>

#include "equations.hpp"

namespace rubato::tests {
/// Those of this program so far; 0 where they are not counted.
std::size_t allocations_so_far();
}  // namespace rubato::tests

using namespace rubato;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

enum class Fault { none, undefined, singular };

/// A solver with a system of its own.
class Subject {
public:
  virtual ~Subject() = default;
  /// The sound matrix.
  [[nodiscard]] virtual MatrixXd dense() const = 0;
  /// Solves the system, or one that differs from it by an entry that is no number, or by a row of zeros.
  [[nodiscard]] virtual Status solve(Fault fault, const VectorXd& b, VectorXd& x) = 0;
};

MatrixXd random_matrix(Index rows, Index columns, unsigned seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> value(-1.0, 1.0);
  return MatrixXd::NullaryExpr(rows, columns, [&] { return value(random); });
}

MatrixXd spoilt(MatrixXd A, Fault fault) {
  if (fault == Fault::undefined) {
    A(A.rows() - 1, 0) = nan;
  } else if (fault == Fault::singular) {
    A.row(A.rows() - 1).setZero();
  }
  return A;
}

/// Solvers that are given a matrix: `Solve` is called with it.
template <typename Solve>
class OfMatrix final : public Subject {
public:
  OfMatrix(Index n, Solve solve) : A_(random_matrix(n, n, 3)), sound_(A_), solve_(std::move(solve)) {
    undefined_ = spoilt(A_, Fault::undefined);
    singular_ = spoilt(A_, Fault::singular);
  }
  [[nodiscard]] MatrixXd dense() const override { return A_; }
  [[nodiscard]] Status solve(Fault fault, const VectorXd& b, VectorXd& x) override {
    return solve_(fault == Fault::none ? sound_ : fault == Fault::undefined ? undefined_ : singular_, b, x);
  }

private:
  MatrixXd A_, sound_, undefined_, singular_;
  Solve solve_;
};

template <typename Solve>
std::unique_ptr<Subject> of_matrix(Index n, Solve solve) {
  return std::make_unique<OfMatrix<Solve>>(n, std::move(solve));
}

std::unique_ptr<Subject> dense_solver(int n) {
  return of_matrix(
      n, [solver = std::make_shared<solve::DenseSolver>(n)](const MatrixXd& A, const VectorXd& b, VectorXd& x) {
        const Status status = solver->factor(A.data());
        x = b;
        if (status == Status::success) {
          solver->solve(x.data());
        }
        return status;
      });
}

std::unique_ptr<Subject> sparse_factors() {
  return of_matrix(
      13, [solver = std::make_shared<solve::SparseFactors>()](const MatrixXd& A, const VectorXd& b, VectorXd& x) {
        const Status status = solver->factor(A.sparseView());
        x = status == Status::success ? VectorXd(solver->solve(b)) : b;
        return status;
      });
}

/// A band that is as wide as the matrix.
std::unique_ptr<Subject> band_solver() {
  const int n = 13;
  return of_matrix(n, [solver = std::make_shared<solve::BandSolver>(n, n - 1, n - 1)](const MatrixXd& A,
                                                                                      const VectorXd& b, VectorXd& x) {
    solver->clear();
    for (int i = 0; i < A.rows(); ++i) {
      for (int j = 0; j < A.cols(); ++j) {
        solver->entry(i, j) = A(i, j);
      }
    }
    const Status status = solver->factor();
    x = b;
    if (status == Status::success) {
      solver->solve(x.data());
    }
    return status;
  });
}

std::unique_ptr<Subject> fixed_solver() {
  return of_matrix(4, [solver = solve::FixedSolver<4>()](const MatrixXd& A, const VectorXd& b, VectorXd& x) mutable {
    const Status status = solver.factor(A.data());
    x = b;
    if (status == Status::success) {
      solver.solve(x.data());
    }
    return status;
  });
}

std::unique_ptr<Subject> small_quotient() {
  return of_matrix(5, [](const MatrixXd& A, const VectorXd& b, VectorXd& x) {
    const auto found = solve::quotient(A, b);
    x = found ? VectorXd(*found) : b;
    return found ? Status::success : A.allFinite() ? Status::singular : Status::undefined;
  });
}

std::unique_ptr<Subject> small_inverse() {
  return of_matrix(5, [](const MatrixXd& A, const VectorXd& b, VectorXd& x) {
    const solve::Inverse found = solve::inverse_of(A.cast<std::complex<double>>());
    const bool finite = found.matrix.allFinite();
    x = finite ? VectorXd((found.matrix * b.cast<std::complex<double>>()).real()) : b;
    return finite ? Status::success : A.allFinite() ? Status::singular : Status::undefined;
  });
}

std::unique_ptr<Subject> gmres() {
  constexpr Index n = 12;
  return of_matrix(n,
                   [solver = std::make_shared<solve::Gmres>(n, 12)](const MatrixXd& A, const VectorXd& b, VectorXd& x) {
                     const auto apply = [&](const double* in, double* out) {
                       for (Index i = 0; i < n; ++i) {
                         double sum = 0.0;
                         for (Index j = 0; j < n; ++j) {
                           sum += A(i, j) * in[j];
                         }
                         out[i] = sum;
                       }
                     };
                     x.setZero();
                     return solver->solve(apply, {b.data(), n}, {x.data(), n}).status;
                   });
}

/// A cyclic system of two fields, with or without a border.
class Cyclic final : public Subject {
public:
  Cyclic(int borders, bool sparse)
      : borders_(borders),
        sparse_(sparse),
        solver_(block, cells, borders),
        right_side_(block, cells),
        solution_(right_side_),
        border_solution_(static_cast<std::size_t>(borders)),
        values_(cells, 0.3) {
    matrix_ = {.block = block, .cells = cells, .left = {0.4, 0.2, 0.1, 1.0}, .right = {1.0, 0.1, -0.2, 0.4}};
    values_[4] = -0.5;
    matrix_.entries = {{1, 0, 0.5, 0.25, values_.data()}};
    border_.count = borders;
    border_.columns.assign(static_cast<std::size_t>(borders * block), {0.5, nullptr});
    border_.rows.assign(static_cast<std::size_t>(borders * block), {0.25, nullptr});
    border_.corner.assign(static_cast<std::size_t>(borders * borders), 1.0);
  }
  [[nodiscard]] MatrixXd dense() const override {
    const Index n = block * static_cast<Index>(cells);
    MatrixXd A = MatrixXd::Zero(n + borders_, n + borders_);
    for (std::size_t i = 0; i < cells; ++i) {
      for (int r = 0; r < block; ++r) {
        const auto row = static_cast<Index>(static_cast<std::size_t>(r) * cells + i);
        for (int c = 0; c < block; ++c) {
          const std::size_t here = static_cast<std::size_t>(c) * cells;
          const auto place = static_cast<std::size_t>(r * block + c);
          A(row, static_cast<Index>(here + i)) += matrix_.left[place];
          A(row, static_cast<Index>(here + (i + 1) % cells)) += matrix_.right[place];
        }
        if (r == 1) {
          A(row, static_cast<Index>(i)) += 0.5 * values_[i];
          A(row, static_cast<Index>((i + 1) % cells)) += 0.25 * values_[i];
        }
      }
    }
    A.topRightCorner(n, borders_).setConstant(0.5);
    A.bottomLeftCorner(borders_, n).setConstant(0.25);
    A.bottomRightCorner(borders_, borders_).setConstant(1.0);
    return A;
  }
  [[nodiscard]] Status solve(Fault fault, const VectorXd& b, VectorXd& x) override {
    const auto sound = fault == Fault::none ? solve::CyclicBidiagonal() : matrix_;
    if (fault == Fault::undefined) {
      values_[2] = nan;
    } else if (fault == Fault::singular) {
      matrix_.left[0] = matrix_.left[1] = matrix_.right[0] = matrix_.right[1] = 0.0;
      border_.columns.assign(border_.columns.size(), {0.0, nullptr});
    }
    const std::size_t n = block * cells;
    std::copy_n(b.data(), n, right_side_.all().begin());
    const std::span<const double> border_right(b.data() + n, static_cast<std::size_t>(borders_));
    const auto right = std::as_const(right_side_).pointers();
    const auto into = solution_.pointers();
    const Status status =
        sparse_ ? (solve::cyclic_is_finite(matrix_, border_, right, border_right)
                       ? solve::solve_cyclic_by_sparse_lu(matrix_, border_, right, border_right, into, border_solution_)
                       : Status::undefined)
                : solver_.solve(matrix_, border_, right, border_right, into, border_solution_).status;
    std::copy_n(solution_.all().begin(), n, x.data());
    std::copy(border_solution_.begin(), border_solution_.end(), x.data() + n);
    if (fault != Fault::none) {
      matrix_ = sound;
      border_.columns.assign(border_.columns.size(), {0.5, nullptr});
      values_[2] = 0.3;
    }
    return status;
  }

private:
  static constexpr int block = 2;
  static constexpr std::size_t cells = 37;
  int borders_;
  bool sparse_;
  solve::CyclicBlockSolver solver_;
  grids::FieldSet right_side_, solution_;
  std::vector<double> border_solution_, values_;
  solve::CyclicBidiagonal matrix_;
  solve::CyclicBorder border_;
};

/// The systems of a step: two free fields of a wave equation, on a line or in the plane, at cells or at nodes.
class OfCells final : public Subject {
public:
  using Make = std::unique_ptr<CellSolver> (*)(const grids::Grid& grid, int size);

  OfCells(const grids::Grid& grid, bool nodes, Make make)
      : grid_(grid),
        nodes_(nodes),
        solver_(make(grid, size)),
        values_(1, grid.size()),
        right_side_(size, grid.size()),
        solution_(right_side_) {
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> value(0.5, 1.5);
    for (double& v : values_.all()) {
      v = value(random);
    }
    matrix_.mean = MatrixXd::Zero(size, size);
    matrix_.mean.diagonal() << -40.0, 1.0;
    for (int a = 0; a < grid.dimensions(); ++a) {
      MatrixXd K = MatrixXd::Zero(size, size);
      K(0, 1) = a == 0 ? 1.0 : 0.5;
      K(1, 0) = -K(0, 1);
      matrix_.difference.push_back(K);
    }
    matrix_.entries = {{0, 0, -1.0, values_.field(0).data()}};
    solver_->check_residuals(true);
  }
  [[nodiscard]] MatrixXd dense() const override {
    const auto n = static_cast<Index>(grid_.size());
    MatrixXd A = MatrixXd::Zero(size * n, size * n);
    grids::Stencil stencil(grid_);
    const int dimensions = grid_.dimensions();
    const auto mean = nodes_ ? grids::SpaceOperator::identity() : grids::SpaceOperator::average(dimensions);
    std::vector<double> unit(grid_.size()), out(grid_.size());
    for (Index j = 0; j < n; ++j) {
      unit.assign(unit.size(), 0.0);
      unit[static_cast<std::size_t>(j)] = 1.0;
      const auto add = [&](const MatrixXd& block, const double* factors) {
        for (Index i = 0; i < n; ++i) {
          const double weight = out[static_cast<std::size_t>(i)] * (factors == nullptr ? 1.0 : factors[i]);
          for (int r = 0; r < size; ++r) {
            for (int c = 0; c < size; ++c) {
              A(r * n + i, c * n + j) += weight * block(r, c);
            }
          }
        }
      };
      stencil.apply(mean, unit.data(), out.data());
      add(matrix_.mean, nullptr);
      add((MatrixXd(size, size) << -1.0, 0.0, 0.0, 0.0).finished(), values_.field(0).data());
      for (int a = 0; a < dimensions; ++a) {
        stencil.apply(
            nodes_ ? grids::SpaceOperator::spectral_derivative(a) : grids::SpaceOperator::box_difference(a, dimensions),
            unit.data(), out.data());
        add(matrix_.difference[static_cast<std::size_t>(a)], nullptr);
      }
    }
    return A;
  }
  [[nodiscard]] Status solve(Fault fault, const VectorXd& b, VectorXd& x) override {
    const double old = values_.field(0)[3];
    if (fault == Fault::undefined) {
      values_.field(0)[3] = nan;
    } else if (fault == Fault::singular) {
      matrix_.mean(1, 1) = 0.0;
      for (MatrixXd& K : matrix_.difference) {
        K(1, 0) *= 1e-300;  // a row of zeros to rounding; K(1, 0) = 0 would be another pattern
      }
    }
    std::copy_n(b.data(), right_side_.all().size(), right_side_.all().begin());
    const Status status =
        solver_->solve(matrix_, none_, std::as_const(right_side_).pointers(), solution_.pointers(), {});
    std::copy_n(solution_.all().begin(), solution_.all().size(), x.data());
    if (fault != Fault::none) {
      values_.field(0)[3] = old;
      matrix_.mean(1, 1) = 1.0;
      for (MatrixXd& K : matrix_.difference) {
        K(1, 0) = -K(0, 1);
      }
      solver_->forget();
    }
    return status;
  }

private:
  static constexpr int size = 2;
  grids::Grid grid_;
  bool nodes_;
  std::unique_ptr<CellSolver> solver_;
  grids::FieldSet values_, right_side_, solution_;
  CellMatrix matrix_;
  KernelConditions none_;
};

const grids::Grid line({{"x", -1, 1, 25}});
const grids::Grid plane({{"x", -1, 1, 7}, {"y", -1, 1, 5}});

/// A convolution on a line: 3 z_i + z_{i+1} + ..., by its inverse in Fourier space.
class Waves final : public Subject {
public:
  [[nodiscard]] MatrixXd dense() const override {
    const auto n = static_cast<Index>(line.size());
    MatrixXd A = 3.0 * MatrixXd::Identity(n, n);
    for (Index i = 0; i < n; ++i) {
      A(i, (i + 1) % n) += 1.0;
    }
    return A;
  }
  [[nodiscard]] Status solve(Fault fault, const VectorXd& b, VectorXd& x) override {
    const Status status = inverse_.factor([&](const auto& k, std::complex<double>* m) {
      const double angle = grids::wave_angle(k[0], line.cells(0));
      m[0] = fault == Fault::undefined ? nan : fault == Fault::singular ? 0.0 : 3.0 + std::polar(1.0, angle);
    });
    x = b;
    if (status == Status::success) {
      inverse_(x.data(), x.data());
    }
    return status == Status::success && inverse_.deficient_waves() > 0 ? Status::singular : status;
  }

private:
  solve::FourierPreconditioner inverse_{line, 1};
};

/// P(μ) of one wave of sine-Gordon, with its real and imaginary parts as unknowns of their own.
class Resolvent final : public Subject {
public:
  Resolvent() : P_(2.0 * system_.M().cast<std::complex<double>>() - L_.cast<std::complex<double>>()) {
    P_ += std::complex<double>(0.0, wave) * system_.K(0).cast<std::complex<double>>();
  }
  [[nodiscard]] MatrixXd dense() const override {
    MatrixXd A(6, 6);
    A << P_.real(), -P_.imag(), P_.imag(), P_.real();
    return A;
  }
  [[nodiscard]] Status solve(Fault, const VectorXd& b, VectorXd& x) override {
    WaveBlock inverse, entry;
    resolvent_.inverse(2.0, 0, 1, inverse);
    const std::complex<double> of_determinant(inverse.re[0], inverse.im[0]);
    x.setZero();
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) {
        if (resolvent_.is_zero(r, c)) {
          continue;
        }
        resolvent_.entry(r, c, 2.0, 0, 1, entry);
        const auto product =
            std::complex<double>(entry.re[0], entry.im[0]) * of_determinant * std::complex<double>(b[c], b[3 + c]);
        x[r] += product.real();
        x[3 + r] += product.imag();
      }
    }
    return resolvent_.status();
  }

private:
  static constexpr double wave = 1.3;
  [[nodiscard]] static std::vector<std::vector<double>> waves() { return {{wave}}; }

  MultisymplecticSystem system_ = tests::sine_gordon();
  MatrixXd L_ = Eigen::Vector3d(0.7, 1.0, -1.0).asDiagonal();
  Eigen::MatrixXcd P_;
  std::vector<std::vector<double>> waves_ = waves();
  WaveResolvent resolvent_{system_, waves_, L_, 2.0, {0, 1, 2}};
};

/// A line for each.
struct Member {
  const char* name;
  const char* header;  ///< where it is declared
  std::unique_ptr<Subject> (*make)();
  bool allocates = false;  ///< in a solve; others do not
  bool faults = true;      ///< there are matrices that it cannot take
};

template <int n>
std::unique_ptr<Subject> dense_of() {
  return dense_solver(n);
}

const Member members[] = {
    {"BandSolver", "solve/band_solver.hpp", band_solver},
    {"DenseSolver, unrolled", "solve/dense_solver.hpp", dense_of<3>},
    {"DenseSolver, in loops", "solve/dense_solver.hpp", dense_of<13>},
    {"DenseSolver, by blocks", "solve/dense_solver.hpp", dense_of<40>},
    {"FixedSolver", "solve/elimination.hpp", fixed_solver},
    {"quotient", "solve/small_matrices.hpp", small_quotient, true},
    {"inverse_of", "solve/small_matrices.hpp", small_inverse, true},
    {"SparseFactors", "solve/sparse_factors.hpp", sparse_factors, true},
    {"Gmres", "solve/gmres.hpp", gmres},
    {"FourierPreconditioner", "solve/fourier_preconditioner.hpp",
     []() -> std::unique_ptr<Subject> { return std::make_unique<Waves>(); }},
    {"CyclicBlockSolver", "solve/cyclic_block.hpp",
     []() -> std::unique_ptr<Subject> { return std::make_unique<Cyclic>(0, false); }},
    {"CyclicBlockSolver, bordered", "solve/cyclic_block.hpp",
     []() -> std::unique_ptr<Subject> { return std::make_unique<Cyclic>(1, false); }},
    {"solve_cyclic_by_sparse_lu", "solve/cyclic_sparse.hpp",
     []() -> std::unique_ptr<Subject> { return std::make_unique<Cyclic>(1, true); }, true},
    {"make_cyclic_cell_solver", "pde/cell_solver.hpp",
     []() -> std::unique_ptr<Subject> {
       return std::make_unique<OfCells>(
           line, false, [](const grids::Grid& grid, int size) { return make_cyclic_cell_solver(grid, size, 0); });
     }},
    {"make_gmres_cell_solver", "pde/cell_solver.hpp",
     []() -> std::unique_ptr<Subject> {
       return std::make_unique<OfCells>(plane, false, [](const grids::Grid& grid, int size) {
         return make_gmres_cell_solver(grid, Collocation::cells, size, 1e-13);
       });
     }},
    {"make_cell_solver", "pde/cell_solver.hpp",
     []() -> std::unique_ptr<Subject> {
       return std::make_unique<OfCells>(line, true, [](const grids::Grid& grid, int size) {
         return make_cell_solver(grid, Collocation::nodes, size, 0, 1e-13);
       });
     }},
    {"WaveResolvent", "pde/wave_resolvent.hpp",
     []() -> std::unique_ptr<Subject> { return std::make_unique<Resolvent>(); }, true, false},
};

VectorXd right_side(const MatrixXd& A, unsigned seed) {
  return random_matrix(A.rows(), 1, seed);
}

}  // namespace

TEST_CASE("every solver of linear systems solves them backward stably") {
  for (const Member& member : members) {
    INFO(member.name);
    const auto subject = member.make();
    MatrixXd A = subject->dense();
    // Growth of elimination on some dozen unknowns, and what iterations are asked for.
    const double tolerance = 1e-12;
    for (const unsigned seed : {1U, 2U, 3U}) {
      const VectorXd b = right_side(A, seed);
      VectorXd x = VectorXd::Zero(b.size());
      REQUIRE(subject->solve(Fault::none, b, x) == Status::success);
      CHECK((A * x - b).norm() < tolerance * A.norm() * x.norm());
      A(0, 0) += 1e-6;  // the twin: another matrix
      CHECK((A * x - b).norm() > tolerance * A.norm() * x.norm());
      A(0, 0) = subject->dense()(0, 0);
    }
  }
}

TEST_CASE("every solver of linear systems says what it cannot solve, and goes on as if that had not been") {
  for (const Member& member : members) {
    INFO(member.name);
    const auto plain = member.make(), tried = member.make();
    const VectorXd b = right_side(plain->dense(), 7);
    VectorXd expected = VectorXd::Zero(b.size()), found = expected;
    REQUIRE(plain->solve(Fault::none, b, expected) == Status::success);
    if (member.faults) {
      CHECK(tried->solve(Fault::undefined, b, found) == Status::undefined);
      const Status status = tried->solve(Fault::singular, b, found);
      CHECK(status != Status::success);
      CHECK(status != Status::undefined);
    }
    REQUIRE(tried->solve(Fault::none, b, found) == Status::success);
    CHECK((found.array() == expected.array()).all());
    REQUIRE(tried->solve(Fault::none, right_side(plain->dense(), 8), found) == Status::success);
    CHECK_FALSE((found.array() == expected.array()).all());  // the twin
  }
}

TEST_CASE("every solver of linear systems gives the same bits for every number of threads, and allocates nothing") {
  const int threads = omp_get_max_threads();
  for (const Member& member : members) {
    INFO(member.name);
    const auto subject = member.make();
    const VectorXd b = right_side(subject->dense(), 9);
    VectorXd one = VectorXd::Zero(b.size()), three = one;
    omp_set_num_threads(1);
    REQUIRE(subject->solve(Fault::none, b, one) == Status::success);
    const std::size_t before = tests::allocations_so_far();
    const Status again = subject->solve(Fault::none, b, one);
    const std::size_t allocated = tests::allocations_so_far() - before;
    REQUIRE(again == Status::success);
    if (!member.allocates) {
      CHECK(allocated == 0);
    }
    omp_set_num_threads(3);
    const auto other = member.make();
    REQUIRE(other->solve(Fault::none, b, three) == Status::success);
    REQUIRE(other->solve(Fault::none, b, three) == Status::success);
    omp_set_num_threads(threads);
    CHECK((one.array() == three.array()).all());
  }
}

TEST_CASE("unknowns that are coupled to no others get no rounding errors of theirs") {
  // Of a field and what is conjugate to it, each is in the equation at the other's place.
  const grids::Grid grid({{"x", 0.0, 1.0, 33}});
  const auto largest_of_second = [&](double coupling) {
    CellMatrix matrix{.mean = MatrixXd::Zero(2, 2), .difference = {MatrixXd::Zero(2, 2)}, .entries = {}};
    matrix.mean << coupling, -20.0, 20.0, 0.0;
    const VectorXd b = random_matrix(33, 1, 7), zero = VectorXd::Zero(33);
    VectorXd first(33), second(33);
    const std::vector<const double*> rhs = {zero.data(), b.data()};
    const std::vector<double*> solution = {first.data(), second.data()};
    REQUIRE(make_cyclic_cell_solver(grid, 2, 0)->solve(matrix, {}, rhs, solution, {}) == Status::success);
    CHECK(first.norm() > 0.01);
    return second.cwiseAbs().maxCoeff();
  };
  CHECK(largest_of_second(0.0) == 0.0);
  CHECK(largest_of_second(1e-6) > 1e-10);  // the twin: one that is coupled
}

TEST_CASE("no solver of linear systems is missing here") {
  // A header declares one if something in it solves, factors or inverts and returns how that went.
  const std::regex declares(R"((Status|Outcome|optional<Eigen::MatrixXd>|Inverse|unique_ptr<CellSolver>)\s+)"
                            R"((solve\w*|factor|quotient|inverse_of|make_\w*solver)\()");
  std::set<std::string> declared, tested;
  for (const Member& member : members) {
    tested.insert(member.header);
  }
  const std::filesystem::path root = RUBATO_SOURCES;
  for (const char* room : {"solve", "pde"}) {
    for (const auto& entry : std::filesystem::directory_iterator(root / room)) {
      const std::string name = entry.path().filename();
      const bool of_matrices = std::string(room) == "solve" || name.find("solver") != std::string::npos;
      if (entry.path().extension() != ".hpp" || !of_matrices) {
        continue;
      }
      std::stringstream text;
      text << std::ifstream(entry.path()).rdbuf();
      if (std::regex_search(text.str(), declares)) {
        declared.insert(std::string(room) + "/" + name);
      }
    }
  }
  tested.insert(
      "solve/damped_least_squares.hpp");     // of any rank and shape, by its damping: tested with boundary values
  tested.insert("solve/damped_newton.hpp");  // an interface, of the equations that Newton's method solves
  tested.erase("pde/wave_resolvent.hpp");    // an inverse by polynomials, found when it is made
  CHECK(declared == tested);
}
