#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <rubato/base/state.hpp>
#include <rubato/base/status.hpp>
#include <rubato/ode/orbit_tangent.hpp>

namespace rubato {

/// Derivatives ∂z_k/∂λ of a discrete orbit by parameters λ of H, its start and its levels held fixed.
///
/// A parameter is a coordinate that rests: with λ among the coordinates, and H free of the momentum that belongs to it,
/// each scheme takes the steps that it takes with the number in its place. The tangent of that larger map has ∂z_k/∂λ
/// as the image of the unit vector of λ: there is no other formula than that of OrbitTangent.
class Sensitivities {
public:
  /// H with these parameters, in their order, as its last coordinates; or as its last momenta, where a splitting needs
  /// T to have them.
  using Extend = std::function<Hamiltonian(bool as_momenta)>;

  /// \param values of the parameters \throws std::invalid_argument as the scheme's own function, if it takes the larger
  /// H neither way
  Sensitivities(const Extend& extend, const SegmentLagrangian& lagrangian, std::span<const double> z_0,
                std::vector<double> values);

  /// Takes the step, which follows the one taken last. Once it fails all that follows is not a number.
  [[nodiscard]] Status step(std::span<const double> z_0, std::span<const double> z_1, double t_0, double h);
  /// ∂z_k/∂λ, 2n numbers for each parameter, one parameter after the other.
  [[nodiscard]] std::span<const double> derivatives() const { return derivatives_; }

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  void extend(std::span<const double> z, std::vector<double>& to) const;
  void read();

  std::vector<double> values_;
  std::size_t n_;
  bool as_momenta_ = false;
  std::unique_ptr<OrbitTangent> tangent_;
  std::vector<double> columns_, begin_, end_, derivatives_;
};

}  // namespace rubato
