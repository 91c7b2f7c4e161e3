#include "snes.hpp"

#include <petscsnes.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <utility>

namespace peers {

namespace {

void check(PetscErrorCode error) {
  if (error != 0) {
    throw std::runtime_error("PETSc failed");
  }
}

void begin_once() {
  static const bool begun = [] {
    check(PetscInitializeNoArguments());
    check(PetscPopSignalHandler());
    return true;
  }();
  static_cast<void>(begun);
}

}  // namespace

struct SnesBox::Storage {
  std::size_t cells = 0;
  double dx = 0.0, h = 0.0;
  std::vector<double> u, v;  ///< at the level
  std::array<std::vector<double>, 4>
      before;  ///< u and w in turn, in the middle of the steps before, the last one first
  std::size_t known = 0;
  std::vector<std::size_t> places;  ///< of a cell's two entries that vary, in the matrix
  int iterations = 0;
  Vec x = nullptr, f = nullptr;
  Mat matrix = nullptr;
  SNES snes = nullptr;

  [[nodiscard]] std::size_t next(std::size_t i) const { return i + 1 == cells ? 0 : i + 1; }

  static PetscErrorCode residual(SNES /*snes*/, Vec at, Vec to, void* self) {
    return static_cast<const Storage*>(self)->evaluate(at, to);
  }
  static PetscErrorCode jacobian(SNES /*snes*/, Vec at, Mat to, Mat /*same*/, void* self) {
    return static_cast<const Storage*>(self)->differentiate(at, to);
  }

  PetscErrorCode evaluate(Vec at, Vec to) const {
    const double* z = nullptr;
    double* out = nullptr;
    PetscCall(VecGetArrayRead(at, &z));
    PetscCall(VecGetArrayWrite(to, &out));
    const double square = 4.0 / (h * h), velocity = 2.0 / h, inverse = 1.0 / dx;
    const auto cell = [&](std::size_t i, std::size_t n) {
      const double rate = 0.5 * (square * ((z[2 * i] - u[i]) + (z[2 * n] - u[n])) - velocity * (v[i] + v[n]));
      out[2 * i] = inverse * (z[2 * n + 1] - z[2 * i + 1]) - rate - std::sin(0.5 * (z[2 * i] + z[2 * n]));
      out[2 * i + 1] = inverse * (z[2 * n] - z[2 * i]) - 0.5 * (z[2 * i + 1] + z[2 * n + 1]);
    };
    for (std::size_t i = 0; i + 1 < cells; ++i) {
      cell(i, i + 1);
    }
    cell(cells - 1, 0);
    PetscCall(VecRestoreArrayRead(at, &z));
    PetscCall(VecRestoreArrayWrite(to, &out));
    return 0;
  }

  PetscErrorCode differentiate(Vec at, Mat to) const {
    const double* z = nullptr;
    double* entries = nullptr;
    PetscCall(VecGetArrayRead(at, &z));
    PetscCall(MatSeqAIJGetArray(to, &entries));
    for (std::size_t i = 0; i < cells; ++i) {
      const double entry = -2.0 / (h * h) - 0.5 * std::cos(0.5 * (z[2 * i] + z[2 * next(i)]));
      entries[places[2 * i]] = entry;
      entries[places[2 * i + 1]] = entry;
    }
    PetscCall(MatSeqAIJRestoreArray(to, &entries));
    PetscCall(VecRestoreArrayRead(at, &z));
    PetscCall(MatAssemblyBegin(to, MAT_FINAL_ASSEMBLY));
    PetscCall(MatAssemblyEnd(to, MAT_FINAL_ASSEMBLY));
    return 0;
  }

  void make_matrix() {
    const auto rows = static_cast<PetscInt>(2 * cells);
    check(MatCreateSeqAIJ(PETSC_COMM_SELF, rows, rows, 4, nullptr, &matrix));
    for (std::size_t i = 0; i < cells; ++i) {
      const auto a = static_cast<PetscInt>(2 * i), b = static_cast<PetscInt>(2 * next(i));
      const std::array<PetscInt, 4> columns = {a, a + 1, b, b + 1};
      const std::array<PetscInt, 2> both = {a, a + 1};
      const double d = 1.0 / dx;
      const std::array<double, 8> entries = {1.0, -d, 1.0, d, -d, -0.5, d, -0.5};
      check(MatSetValues(matrix, 2, both.data(), 4, columns.data(), entries.data(), INSERT_VALUES));
    }
    check(MatAssemblyBegin(matrix, MAT_FINAL_ASSEMBLY));
    check(MatAssemblyEnd(matrix, MAT_FINAL_ASSEMBLY));
    const PetscInt* row = nullptr;
    const PetscInt* column = nullptr;
    PetscInt n = 0;
    PetscBool done = PETSC_FALSE;
    check(MatGetRowIJ(matrix, 0, PETSC_FALSE, PETSC_FALSE, &n, &row, &column, &done));
    for (std::size_t i = 0; i < cells; ++i) {
      for (const std::size_t node : {i, next(i)}) {
        const PetscInt* const end = column + row[2 * i + 1];
        const PetscInt* const at = std::find(column + row[2 * i], end, static_cast<PetscInt>(2 * node));
        places.push_back(static_cast<std::size_t>(at - column));
      }
    }
    check(MatRestoreRowIJ(matrix, 0, PETSC_FALSE, PETSC_FALSE, &n, &row, &column, &done));
  }

  void make_solver() {
    check(SNESCreate(PETSC_COMM_SELF, &snes));
    check(SNESSetType(snes, SNESNEWTONLS));
    check(SNESSetFunction(snes, f, residual, this));
    check(SNESSetJacobian(snes, matrix, matrix, jacobian, this));
    SNESLineSearch search = nullptr;
    check(SNESGetLineSearch(snes, &search));
    check(SNESLineSearchSetType(search, SNESLINESEARCHBASIC));
    KSP ksp = nullptr;
    PC pc = nullptr;
    check(SNESGetKSP(snes, &ksp));
    check(KSPSetType(ksp, KSPPREONLY));
    check(KSPGetPC(ksp, &pc));
    check(PCSetType(pc, PCLU));
    check(PCFactorSetMatSolverType(pc, MATSOLVERKLU));
    // Down to what some roundings of the largest terms leave of a row, in the norm of all rows.
    const double largest = 4.0 * 4.0 / (h * h) + 4.0 / dx, epsilon = std::numeric_limits<double>::epsilon();
    const double rounding = 2.0 * epsilon * largest * std::sqrt(2.0 * static_cast<double>(cells));
    check(SNESSetTolerances(snes, rounding, 0.0, 0.0, 20, 1000));
    check(SNESSetFromOptions(snes));
  }

  /// The cubic through what is known, at the next step.
  void begin_at(double* z) const {
    constexpr double weights[4][4] = {{1, 0, 0, 0}, {2, -1, 0, 0}, {3, -3, 1, 0}, {4, -6, 4, -1}};
    for (std::size_t i = 0; i < 2 * cells; ++i) {
      z[i] = 0.0;
      for (std::size_t back = 0; back < known; ++back) {
        z[i] += weights[known - 1][back] * before[back][i];
      }
    }
    for (std::size_t i = 0; known == 0 && i < cells; ++i) {
      z[2 * i] = u[i];
    }
  }
};

SnesBox::SnesBox(const Line& line, const Function& u, const Function& u_t, double h)
    : storage_(std::make_unique<Storage>()) {
  begin_once();
  Storage& all = *storage_;
  all.cells = line.nodes;
  all.dx = line.length / static_cast<double>(line.nodes);
  all.h = h;
  for (std::size_t i = 0; i < line.nodes; ++i) {
    all.u.push_back(u(line.node(i)));
    all.v.push_back(u_t(line.node(i)));
  }
  all.before.fill(std::vector<double>(2 * line.nodes));
  check(VecCreateSeq(PETSC_COMM_SELF, static_cast<PetscInt>(2 * line.nodes), &all.x));
  check(VecDuplicate(all.x, &all.f));
  all.make_matrix();
  all.make_solver();
}

SnesBox::~SnesBox() {
  static_cast<void>(SNESDestroy(&storage_->snes));
  static_cast<void>(MatDestroy(&storage_->matrix));
  static_cast<void>(VecDestroy(&storage_->f));
  static_cast<void>(VecDestroy(&storage_->x));
}

bool SnesBox::step() {
  Storage& all = *storage_;
  double* z = nullptr;
  check(VecGetArray(all.x, &z));
  all.begin_at(z);
  check(VecRestoreArray(all.x, &z));
  check(SNESSolve(all.snes, nullptr, all.x));
  SNESConvergedReason reason = SNES_CONVERGED_ITERATING;
  PetscInt iterations = 0;
  check(SNESGetConvergedReason(all.snes, &reason));
  check(SNESGetIterationNumber(all.snes, &iterations));
  all.iterations += static_cast<int>(iterations);
  const double* end = nullptr;
  check(VecGetArrayRead(all.x, &end));
  std::rotate(all.before.begin(), all.before.end() - 1, all.before.end());
  std::copy(end, end + 2 * all.cells, all.before.front().begin());
  all.known = std::min<std::size_t>(all.known + 1, all.before.size());
  for (std::size_t i = 0; i < all.cells; ++i) {
    const double middle = end[2 * i];
    all.v[i] = 4.0 * (middle - all.u[i]) / all.h - all.v[i];
    all.u[i] = 2.0 * middle - all.u[i];
  }
  check(VecRestoreArrayRead(all.x, &end));
  return reason > 0;
}

const std::vector<double>& SnesBox::u() const {
  return storage_->u;
}

int SnesBox::iterations() const {
  return storage_->iterations;
}

}  // namespace peers
