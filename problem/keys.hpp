#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// The tables and keys of a problem file: what the reader accepts is what `rubato help problem` prints.
namespace rubato {

/// A table. Where `names_what` is not empty, its keys are names of the user's: "a parameter", say.
struct TableEntry {
  std::string_view name;  ///< without brackets: "scheme", "initial.next"; empty for the file itself
  std::string_view meaning;
  std::string_view names_what = "";
};
[[nodiscard]] std::span<const TableEntry> problem_tables();

/// A key of one of them.
struct KeyEntry {
  std::string_view table;
  std::string_view name;
  std::string_view type;
  std::string fallback;  ///< what holds where it is left out, or "required"
  std::string meaning;
  std::span<const std::string_view> words = {};  ///< those it may be, where it is a word
};
[[nodiscard]] std::span<const KeyEntry> problem_keys();
/// The keys of one table.
[[nodiscard]] std::vector<std::string_view> keys_of(std::string_view table);

/// True if the reader may ask for a key; "grid.y" and "grid.z" are as "grid.x".
[[nodiscard]] bool is_documented(std::string_view table, std::string_view key);

/// The one table that has a key of that name; nothing if none has it, or several have.
[[nodiscard]] std::optional<std::string_view> table_of(std::string_view key);

// In the order of the enumerations.
inline constexpr std::array<std::string_view, 2> levels_words = {"variable", "fixed"};
inline constexpr std::array<std::string_view, 2> on_singular_words = {"plain", "stop"};
inline constexpr std::array<std::string_view, 2> potential_words = {"none", "auto"};
inline constexpr std::array<std::string_view, 1> fit_words = {"fit"};
inline constexpr std::array<std::string_view, 1> all_words = {"all"};
inline constexpr std::array<std::string_view, 3> darboux_words = {"midpoint", "euler-a", "euler-b"};
inline constexpr std::array<std::string_view, 4> structure_words = {"canonical", "dx", "schroedinger", "dx/(1-dxx)"};
inline constexpr std::array<std::string_view, 3> direction_words = {"both", "up", "down"};
/// The schemes for problems of [hamiltonian], of [lagrangian] and for lattices, and the compositions of explicit
/// splittings, by what the library calls them.
///@{
[[nodiscard]] std::span<const std::string_view> hamiltonian_lagrangians();
[[nodiscard]] std::span<const std::string_view> quadratures();
[[nodiscard]] std::span<const std::string_view> lattice_lagrangians();
[[nodiscard]] std::span<const std::string_view> composition_words();
///@}

/// The directions of a grid.
inline constexpr std::array<std::string_view, 3> axis_letters = {"x", "y", "z"};

}  // namespace rubato
