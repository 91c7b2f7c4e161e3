#pragma once

#include <vector>

#include "case.hpp"

#if RUBATO_HAS_SUNDIALS

#include <memory>
#include <string>

#include <arkode/arkode_erkstep.h>
#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

namespace orbits {

namespace of_sundials {

struct Freed {
  void operator()(N_Vector vector) const { N_VDestroy(vector); }
  void operator()(SUNNonlinearSolver solver) const { SUNNonlinSolFree(solver); }
};
/// CVODE's memory, or ARKODE's.
template <void (*Free)(void**)>
struct Memory {
  void* memory;
  explicit Memory(void* made) : memory(made) {}
  Memory(const Memory&) = delete;
  Memory& operator=(const Memory&) = delete;
  ~Memory() { Free(&memory); }
  operator void*() const { return memory; }  // NOLINT: as their functions take it
};
using Vector = std::unique_ptr<std::remove_pointer_t<N_Vector>, Freed>;
using Solver = std::unique_ptr<std::remove_pointer_t<SUNNonlinearSolver>, Freed>;

inline SUNContext context() {
  static const SUNContext one = [] {
    SUNContext made = nullptr;
    SUNContext_Create(nullptr, &made);
    return made;
  }();
  return one;
}

template <typename System>
int slope(double, N_Vector z, N_Vector f, void*) {
  constexpr std::size_t n = System::n;
  const double* const at = N_VGetArrayPointer(z);
  double* const out = N_VGetArrayPointer(f);
  field<System>(at, at + n, out, out + n);
  return 0;
}

template <typename System>
Vector vector_of(const State<System>& state) {
  constexpr std::size_t n = System::n;
  Vector z(N_VNew_Serial(static_cast<sunindextype>(2 * n), context()));
  std::copy_n(state.q.begin(), n, N_VGetArrayPointer(z.get()));
  std::copy_n(state.p.begin(), n, N_VGetArrayPointer(z.get()) + n);
  return z;
}

/// Runs `go(until, one_step, t)`, by single steps if they are looked at. \return what was taken, and the state
template <typename System, typename Watch, typename Go>
Taken run(double until, State<System>& state, N_Vector z, Watch& watch, Go go) {
  constexpr std::size_t n = System::n;
  const double* const at = N_VGetArrayPointer(z);
  double t = 0.0;
  const double start = peers::cpu_seconds();
  if constexpr (Watch::active) {
    while (t < until) {
      if (go(true, t) < 0) {
        return {std::numeric_limits<double>::infinity(), 0, t};
      }
      watch(at, at + n);
    }
  } else if (go(false, t) < 0) {
    return {std::numeric_limits<double>::infinity(), 0, t};
  }
  const double seconds = peers::cpu_seconds() - start;
  std::copy_n(at, n, state.q.begin());
  std::copy_n(at + n, n, state.p.begin());
  return {seconds, 0, t};
}

}  // namespace of_sundials

/// CVODE by functional iteration with `depth` vectors of Anderson's acceleration: Adams' methods up to order 12, or
/// BDF.
template <typename System>
class Cvode {
public:
  explicit Cvode(int method) : method_(method) {}

  template <typename Watch>
  Taken operator()(int effort, double until, State<System>& state, Watch& watch) {
    using namespace of_sundials;
    const Vector z = vector_of(state);
    const Memory<CVodeFree> memory(CVodeCreate(method_, context()));
    CVodeInit(memory, slope<System>, 0.0, z.get());
    const double tolerance = tolerance_of(effort);
    CVodeSStolerances(memory, tolerance, tolerance);
    const Solver solver(SUNNonlinSol_FixedPoint(z.get(), 0, context()));
    CVodeSetNonlinearSolver(memory, solver.get());
    CVodeSetMaxNumSteps(memory, 20'000'000);
    CVodeSetStopTime(memory, until);
    CVodeSetErrHandlerFn(
        memory, [](int, const char*, const char*, char*, void*) {}, nullptr);
    Taken taken = run(until, state, z.get(), watch, [&](bool one, double& t) {
      return CVode(memory, until, z.get(), &t, one ? CV_ONE_STEP : CV_NORMAL);
    });
    CVodeGetNumSteps(memory, &taken.steps);
    return taken;
  }

private:
  int method_;
};

/// ARKODE's ERKStep with one of its tables; with equal steps, or with its own choice of them.
template <typename System>
class Erk {
public:
  Erk(ARKODE_ERKTableID table, bool equal) : table_(table), equal_(equal) {}

  template <typename Watch>
  Taken operator()(int effort, double until, State<System>& state, Watch& watch) {
    using namespace of_sundials;
    const Vector z = vector_of(state);
    const Memory<ERKStepFree> memory(ERKStepCreate(slope<System>, 0.0, z.get(), context()));
    const double tolerance = tolerance_of(effort);
    ERKStepSStolerances(memory, tolerance, tolerance);
    ERKStepSetTableNum(memory, table_);
    if (equal_) {
      ERKStepSetFixedStep(memory, until / effort);
    }
    ERKStepSetMaxNumSteps(memory, 20'000'000);
    ERKStepSetStopTime(memory, until);
    ERKStepSetErrHandlerFn(
        memory, [](int, const char*, const char*, char*, void*) {}, nullptr);
    Taken taken = run(until, state, z.get(), watch, [&](bool one, double& t) {
      return ERKStepEvolve(memory, until, z.get(), &t, one ? ARK_ONE_STEP : ARK_NORMAL);
    });
    ERKStepGetNumSteps(memory, &taken.steps);
    return taken;
  }

private:
  ARKODE_ERKTableID table_;
  bool equal_;
};

template <typename System>
void add_sundials(const Case<System>& problem, int first, std::vector<Method>& methods) {
  const auto take = [&](const char* name, int effort, auto run) {
    methods.push_back(problem.method(name, Class::sundials, effort, run));
  };
  take("CVODE Adams", 5, Cvode<System>(CV_ADAMS));
  take("CVODE BDF", 5, Cvode<System>(CV_BDF));
  take("ERKStep Fehlberg 8", 3, Erk<System>(ARKODE_FEHLBERG_13_7_8, false));
  take("ERKStep Verner 6", 3, Erk<System>(ARKODE_VERNER_8_5_6, false));
  if (first > 0) {
    take("ERKStep Fehlberg 8, equal", first, Erk<System>(ARKODE_FEHLBERG_13_7_8, true));
  }
}

}  // namespace orbits

#else

namespace orbits {
template <typename System>
void add_sundials(const Case<System>&, int, std::vector<Method>&) {}
}  // namespace orbits

#endif
