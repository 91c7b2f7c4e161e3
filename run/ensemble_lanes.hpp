#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/run/ensemble_member.hpp>

namespace rubato {

/// The number that a TOML value is, where it is written in the usual way: "-1.5e-3". Nothing says nothing of the value.
[[nodiscard]] std::optional<double> plain_number(std::string_view text);

/// True if members are orbits that differ in where they start alone, all reported as plain numbers: then what can be
/// read of one can be read of all.
[[nodiscard]] bool differ_in_starts_alone(const Problem& ensemble);

/// Members on fixed levels of a splitting that have one H, side by side in vectors (SplittingLanes): what is kept of
/// each is what its run alone gives, bit for bit. They may differ in where they start and end, and in their steps.
class MemberLanes {
public:
  /// Null where the members are no such, or where more is kept of them: output at times of its own.
  /// \param figures the names of those to show
  [[nodiscard]] static std::unique_ptr<MemberLanes> make(const Problem& ensemble,
                                                         const std::vector<std::string>& figures);

  /// The results of these members, of which there are at most width(); nothing for one that is to be run alone. Whoever
  /// halts the desk gets none.
  [[nodiscard]] std::vector<std::optional<MemberResult>> run(std::span<const std::size_t> members,
                                                             const MemberDesk& desk);
  [[nodiscard]] std::size_t width() const { return width_; }

  ~MemberLanes();
  MemberLanes(const MemberLanes&) = delete;
  MemberLanes& operator=(const MemberLanes&) = delete;

private:
  class Kind;  ///< those with one H, and all else that is compiled of a problem
  struct Own;  ///< what a member has for itself

  MemberLanes(const Problem& ensemble, const std::vector<std::string>& figures);
  [[nodiscard]] std::optional<Own> read(std::size_t member, std::string& signature) const;

  const Problem& ensemble_;
  const std::vector<std::string>& figures_;
  std::size_t width_ = 8;
  std::optional<Problem> first_;     ///< the first member, where starts alone differ
  std::vector<std::size_t> places_;  ///< and in its z, of each entry that differs
  std::unique_ptr<Kind> kind_;
};

}  // namespace rubato
