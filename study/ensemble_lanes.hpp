#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/ode/integrate.hpp>
#include <rubato/ode/splitting_lanes.hpp>
#include <rubato/study/ensemble_member.hpp>

namespace rubato::study {

/// The number that a TOML value is, where it is written in the usual way: "-1.5e-3". Nothing says nothing of the value.
[[nodiscard]] std::optional<double> plain_number(std::string_view text);

/// Whether members are orbits that differ in where they start alone, all told as plain numbers: then what can be read
/// of one can be read of all.
[[nodiscard]] bool differ_in_starts_alone(const Problem& ensemble);

/// Members that differ in where they start, on fixed levels of a splitting, side by side in vectors (SplittingLanes):
/// what is kept of each is what its run alone gives, bit for bit.
class MemberLanes {
public:
  /// Null where the members are no such, or where more is kept of them: events, output at times of its own.
  /// \param figures the names of those to tell
  [[nodiscard]] static std::unique_ptr<MemberLanes> make(const Problem& ensemble,
                                                         const std::vector<std::string>& figures);

  /// The results of these members, of which there are at most width(); nothing for one that is to be run alone. Whoever
  /// halts the desk gets none.
  [[nodiscard]] std::vector<std::optional<MemberResult>> run(std::span<const std::size_t> members,
                                                             const MemberDesk& desk);
  [[nodiscard]] std::size_t width() const { return lanes_->width(); }

private:
  MemberLanes(const Problem& ensemble, const std::vector<std::string>& figures)
      : ensemble_(ensemble), figures_(figures) {}
  [[nodiscard]] MemberResult result(const SplittingLanes::Start& start, const SplittingLanes::End& end) const;

  const Problem& ensemble_;
  const std::vector<std::string>& figures_;
  std::vector<double> z_;            ///< of the first member, at the start
  std::vector<std::size_t> places_;  ///< in z, of each entry that differs
  std::vector<std::string> invariants_;
  double t_ = 0.0;
  std::size_t laws_every_ = 1;
  IntegrationOptions options_;
  std::unique_ptr<SplittingLanes> lanes_;
};

}  // namespace rubato::study
