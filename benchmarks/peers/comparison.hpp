#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <rubato/pde/lattice.hpp>

#include "peer.hpp"
#include "work.hpp"

/// \file
/// Equations on periodic lines, as peers and as Rubato have them, for the comparison of work against accuracy.

namespace comparison {

/// A problem, as peers and as Rubato have it.
struct Problem {
  std::string name;
  double from = 0.0, length = 1.0, until = 0.0;
  rubato::MultisymplecticSystem system;
  std::vector<int> fields;        ///< that are compared: u; p and q
  peers::Function first, second;  ///< u and u_t, or p and q, at the start
  /// The fields of Rubato's that are given, as InitialFields has them: 0 for none, 1 for `first`, 2 for `second`.
  std::vector<int> given;
  std::function<std::unique_ptr<peers::Peer>(std::size_t nodes)> converged;  ///< for the solution to compare with
  std::size_t converged_nodes = 0;
  int converged_steps = 0;
  double scale = 1.0;  ///< errors are beside it

  [[nodiscard]] peers::Line line(std::size_t nodes) const { return {from, length, nodes}; }
  [[nodiscard]] rubato::grids::Grid grid(std::size_t nodes) const;
  [[nodiscard]] rubato::InitialFields initial(std::size_t nodes) const;
};

/// u_tt = u_xx - sin u: a breather of frequency 1/2 in its first period.
[[nodiscard]] Problem sine_gordon_breather();
/// i ψ_t + ψ_xx + 2|ψ|²ψ = 0: the moving soliton of the catalogue.
[[nodiscard]] Problem schroedinger_soliton();
/// u_t + 6 u u_x + u_xxx = 0: the soliton of speed 4.
[[nodiscard]] Problem korteweg_de_vries_soliton();
/// The same equation by a potential, with S as given.
[[nodiscard]] rubato::MultisymplecticSystem korteweg_de_vries_system(const std::string& S);

/// The solution at `until` and for a while after it.
class Reference {
public:
  explicit Reference(const Problem& problem);
  [[nodiscard]] double error(const std::vector<std::vector<double>>& fields, double t) const;
  [[nodiscard]] double error(const peers::Series& series, std::size_t nodes) const;
  [[nodiscard]] const peers::Series& solution() const { return series_; }  ///< at `until`
  /// Difference from one with half as many steps, on fewer nodes.
  [[nodiscard]] double uncertainty() const { return uncertainty_; }

private:
  const Problem& problem_;
  std::unique_ptr<peers::Peer> peer_;
  peers::Peer::State end_;
  peers::Series series_;
  double uncertainty_ = 0.0;
};

/// A peer's runs on one grid.
[[nodiscard]] Method peer_method(const Problem& problem, const Reference& reference, std::string name,
                                 std::unique_ptr<peers::Peer> peer, std::size_t nodes, int first);
/// Rubato's, of these options.
[[nodiscard]] Method our_method(const Problem& problem, const Reference& reference, rubato::LatticeOptions options,
                                Class kind, std::size_t nodes, int first);
/// All three kinds of ours, for each of these options and grids.
void add_ours(const Problem& problem, const Reference& reference, const std::vector<rubato::LatticeOptions>& options,
              const std::vector<std::size_t>& nodes, int first, std::vector<Method>& methods);
/// Of a splitting, and of `fourier` with so many stages.
///@{
[[nodiscard]] rubato::LatticeOptions splitting(const std::string& composition);
[[nodiscard]] rubato::LatticeOptions gauss(int stages);
///@}

/// A skew matrix from its upper entries.
[[nodiscard]] Eigen::MatrixXd skew(int size, std::initializer_list<std::tuple<int, int, double>> entries);

/// Searches, measures the cheapest of each kind again in turns, and prints.
void report(const Problem& problem, const Reference& reference, const std::vector<Method>& methods, int repeats);

}  // namespace comparison
