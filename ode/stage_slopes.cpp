#include <rubato/ode/stage_slopes.hpp>

#include <algorithm>
#include <span>

#include <rubato/ode/separable.hpp>

namespace rubato {

namespace {

using Eigen::Index;

using formula::Bytecode;
using formula::Expression;

/// The energy with `sign` times its gradient.
Bytecode with_gradient(Expression energy, std::span<const Expression> variables, double sign) {
  std::vector<Expression> outputs = formula::gradient(energy, variables);
  for (Expression& slope : outputs) {
    slope = sign < 0.0 ? -slope : slope;
  }
  outputs.insert(outputs.begin(), energy);
  return Bytecode(outputs, variables);
}

/// Whether T is a quadratic form: of degree two, and ∇T(0) = 0.
bool is_quadratic_form(Expression T, std::span<const Expression> momenta, const Bytecode& velocities) {
  if (!is_quadratic(T, momenta)) {
    return false;
  }
  const std::vector<double> zero(velocities.input_count(), 0.0);
  std::vector<double> at_rest(velocities.output_count());
  formula::ScalarEvaluator(velocities, formula::Engine::interpreter)(zero, at_rest);
  return std::ranges::all_of(at_rest, [](double v) { return v == 0.0; });
}

}  // namespace

StageSlopes::StageSlopes(const Hamiltonian& hamiltonian, const Rows& Z, Rows& f)
    : Z_(Z), f_(f), energies_(Rows::Zero(3, Z.cols())) {
  const Index n = Z.rows() / 2;
  const auto part = [&](const Bytecode& code, Index energy, Index first, Index count) {
    std::vector<const double*> in;
    std::vector<double*> out = {energies_.row(energy).data()};
    for (Index r = first; r < first + count; ++r) {
      in.push_back(Z_.row(r).data());
      out.push_back(f_.row((r + n) % (2 * n)).data());  // f = J∇H
    }
    formula::BatchEvaluator made(code);
    made.bind(static_cast<std::size_t>(Z_.cols()), in, out);
    return made;
  };
  whole_ = part(hamiltonian.gradient_code(), 0, 0, 2 * n);
  const Hamiltonian own = hamiltonian.with_own_graph();
  if (const Separation halves = separate(own); halves.separable()) {
    const auto z = std::span(own.variables());
    const auto half = static_cast<std::size_t>(n);
    const auto q = z.first(half), p = z.subspan(half);
    halves_.emplace(
        Halves{part(with_gradient(halves.T, p, 1.0), 1, n, n), part(with_gradient(halves.V, q, -1.0), 2, 0, n)});
    const Bytecode velocities(formula::gradient(halves.T, p), p);
    if (is_quadratic_form(halves.T, p, velocities)) {
      linear_.emplace(Linear{Rows::Zero(n, Z.cols()), Rows::Zero(n, Z.cols()), formula::BatchEvaluator(velocities)});
      std::vector<const double*> in;
      std::vector<double*> out;
      for (Index r = 0; r < n; ++r) {
        in.push_back(linear_->p.row(r).data());
        out.push_back(linear_->v.row(r).data());
      }
      linear_->evaluate.bind(static_cast<std::size_t>(Z_.cols()), in, out);
      const auto outputs = velocities.outputs();
      linear_->same = velocities.instructions().empty();  // then a register is an input's or a constant's
      for (std::size_t r = 0; r < outputs.size(); ++r) {
        linear_->same = linear_->same && outputs[r] == r;
      }
    }
  }
}

void StageSlopes::evaluate() {
  whole_.run();
  const Index n = Z_.rows() / 2;
  f_.bottomRows(n) = -f_.bottomRows(n);
}

std::size_t StageSlopes::instructions() const {
  const auto of = [](const formula::BatchEvaluator& part) { return part.code().instructions().size(); };
  return linear_ ? of(linear_->evaluate) + of(halves_->V) : halves_ ? of(halves_->T) + of(halves_->V) : of(whole_);
}

}  // namespace rubato
