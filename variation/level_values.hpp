#pragma once

#include <cstddef>
#include <initializer_list>
#include <span>
#include <utility>
#include <vector>

#include <rubato/formula/expression.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/variation/node_code.hpp>

namespace rubato {

/// What formulas of slabs have of one level alone, the same of either: it is evaluated once for each level, at all its
/// nodes, kept for the slab that follows, and read where it was a part of the formulas. Such are the densities of a law
/// that changes from level to level, and functions: of a sine-Gordon lattice cos u.
///
///     std::vector<Expression> outputs = …;                       // of both levels
///     LevelValues values(formulas, arrays, {}, {&outputs});      // outputs read the kept arrays now
///     NodeCode code = formulas.code(outputs);
///     values.take(before, after, follows, read);                 // of each slab
///     code.read({&before, &after, &steady, &values.lower(), &values.upper()}, …);
class LevelValues {
public:
  LevelValues() = default;

  /// How the arrays of the formulas are numbered: so many of the lower level, as many of the upper one, those that no
  /// level changes (coordinates), perhaps others, and from `kept` on the kept ones, all of the lower level first.
  struct Arrays {
    int of_level = 0, steady = 0, kept = 0;
  };

  /// \param always formulas of the upper level at the node: the first of the kept ones, in their order \param formulas
  /// in which parts of one level become reads: all that are among `always`, and of the others those that call functions
  /// and that the formulas have, perhaps at other nodes, of both levels, or of one and in `always`
  LevelValues(NodeFormulas& formulas, Arrays arrays, std::span<const formula::Expression> always,
              std::initializer_list<std::vector<formula::Expression>*> outputs);
  /// For formulas of slabs whose upper level's values others find as well (kept()): all parts that call functions and
  /// are of the lower level become reads.
  LevelValues(NodeFormulas& formulas, Arrays arrays, std::vector<formula::Expression>& of_lower);

  /// Takes the next slab. \param follows `before` is the level that was `after` of the last one \param read(code,
  /// level) lets a code read a level, as both of its slab
  template <class Read>
  void take(const grids::FieldSet& before, const grids::FieldSet& after, bool follows, const Read& read) {
    go_on();
    if (!follows) {
      find(before, lower_, read);
    }
    find(after, upper_, read);
  }
  /// What was the upper level is the lower one of what comes.
  void go_on() { std::swap(lower_, upper_); }
  /// Of a level that no slab leads to, or another upper level.
  template <class Read>
  void take(const grids::FieldSet& level, const Read& read) {
    find(level, upper_, read);
  }

  /// Of the upper level, at these ranges of nodes alone, where it has changed.
  template <class Read>
  void renew(const grids::FieldSet& level, std::span<const grids::NodeRange> ranges, const Read& read) {
    if (upper_.fields() > 0) {
      read(code_, level);
      for (const auto& [begin, end] : ranges) {
        code_.evaluate(0, begin, end, upper_.pointers());
      }
    }
  }

  [[nodiscard]] const grids::FieldSet& lower() const { return lower_; }
  [[nodiscard]] const grids::FieldSet& upper() const { return upper_; }
  [[nodiscard]] grids::FieldSet& upper() { return upper_; }
  /// What is kept, as formulas of the upper level at a node.
  [[nodiscard]] std::span<const formula::Expression> kept() const { return kept_; }

private:
  template <class Read>
  void find(const grids::FieldSet& level, grids::FieldSet& values, const Read& read) {
    if (values.fields() > 0) {
      read(code_, level);
      code_(values.pointers());
    }
  }

  void keep(NodeFormulas& formulas, Arrays arrays, std::span<const formula::Expression> always,
            std::span<std::vector<formula::Expression>* const> outputs, bool of_one_level);

  std::vector<formula::Expression> kept_;
  NodeCode code_;  ///< of the upper level
  grids::FieldSet lower_, upper_;
};

}  // namespace rubato
