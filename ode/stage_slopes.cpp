#include <rubato/ode/stage_slopes.hpp>

#include <span>

#include <rubato/ode/separable.hpp>

namespace rubato {

namespace {

using Eigen::Index;

formula::Bytecode with_gradient(formula::Expression energy, std::span<const formula::Expression> variables) {
  std::vector<formula::Expression> outputs = formula::gradient(energy, variables);
  outputs.insert(outputs.begin(), energy);
  return formula::Bytecode(outputs, variables);
}

}  // namespace

StageSlopes::StageSlopes(const Hamiltonian& hamiltonian, const Rows& Z, Rows& f)
    : Z_(Z), f_(f), energies_(Rows::Zero(3, Z.cols())) {
  const Index n = Z.rows() / 2;
  const auto part = [&](const formula::Bytecode& code, Index energy, Index first, Index count) {
    Part made{formula::BatchEvaluator(code), {}, {energies_.row(energy).data()}};
    for (Index r = first; r < first + count; ++r) {
      made.in.push_back(Z_.row(r).data());
      made.out.push_back(f_.row((r + n) % (2 * n)).data());  // f = J∇H
    }
    return made;
  };
  whole_ = part(hamiltonian.gradient_code(), 0, 0, 2 * n);
  if (const Separation halves = separate(hamiltonian); halves.separable()) {
    const auto z = std::span(hamiltonian.variables());
    const std::size_t half = hamiltonian.degrees_of_freedom();
    halves_.emplace(Halves{part(with_gradient(halves.T, z.subspan(half)), 1, n, n),
                           part(with_gradient(halves.V, z.first(half)), 2, 0, n)});
  }
}

void StageSlopes::evaluate_and_turn(Part& part) {
  part.evaluate(static_cast<std::size_t>(Z_.cols()), part.in, part.out);
  const Index n = Z_.rows() / 2;
  if (!halves_ || &part != &halves_->T) {
    Eigen::Map<Eigen::ArrayXd> forces(f_.row(n).data(), n * f_.cols());
    forces = -forces;
  }
}

std::size_t StageSlopes::instructions() const {
  const auto of = [](const Part& part) { return part.evaluate.code().instructions().size(); };
  return halves_ ? of(halves_->T) + of(halves_->V) : of(whole_);
}

}  // namespace rubato
