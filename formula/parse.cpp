#include <rubato/formula/parse.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <unordered_set>
#include <utility>

#include <fmt/format.h>

#include <rubato/base/draws.hpp>
#include <rubato/formula/loop_builder.hpp>
#include <rubato/formula/operand.hpp>
#include <rubato/formula/special.hpp>
#include <rubato/formula/sum.hpp>
#include <rubato/formula/tokens.hpp>

namespace rubato::formula {

namespace {

constexpr int deepest_nesting = 1000;
constexpr std::size_t most_terms = 1'000'000;

/// Of an operator; 0 for everything else. A loop over operators of at least a given strength reads each level of the
/// grammar.
int strength(const Token& token) {
  const Operator* const found = token.kind == Token::Kind::symbol ? find_operator(token.text.front()) : nullptr;
  return found == nullptr ? 0 : found->strength;
}

class Parser {
public:
  Parser(std::string_view text, Graph& graph, const ParseContext& context)
      : text_(text), graph_(&graph), context_(context), token_(next_token(text, 0)) {}

  Expression parse_all() {
    if (token_.kind == Token::Kind::end) {
      fail(token_.offset, "the formula is empty");
    }
    const Expression result = parse_number();
    if (token_.kind == Token::Kind::end) {
      return result;
    }
    if (token_.is(')')) {
      fail(token_.offset, "this ) closes nothing");
    }
    refuse_after_operand();
  }

private:
  struct Nesting {
    explicit Nesting(Parser& parser) : depth(parser.depth_) {
      if (++depth > deepest_nesting) {
        --depth;
        parser.fail(parser.token_.offset, fmt::format("nesting deeper than {} levels", deepest_nesting));
      }
    }
    ~Nesting() { --depth; }
    Nesting(const Nesting&) = delete;
    Nesting& operator=(const Nesting&) = delete;
    int& depth;
  };

  [[noreturn]] void fail(std::size_t offset, const std::string& reason) const {
    throw ParseError(text_, offset, reason);
  }

  void advance() {
    previous_ = token_;
    token_ = next_token(text_, token_.offset + token_.text.size());
  }

  /// A formula whose value is a number: vectors are vectors in norm and dot only.
  Expression parse_number() {
    const bool vectors = std::exchange(vectors_, false);
    const Expression result = parse_operators(strength_of_sum).number;
    vectors_ = vectors;
    return result;
  }

  /// An argument of norm or dot.
  std::vector<Expression> parse_vector() {
    const bool vectors = std::exchange(vectors_, true);
    Operand result = parse_operators(strength_of_sum);
    vectors_ = vectors;
    return result.is_vector() ? std::move(result.vector) : std::vector{result.number};
  }

  /// operand { operator operand }, with operators that bind at least so strongly.
  Operand parse_operators(int at_least) {
    Operand left = parse_operand();
    for (int s = strength(token_); s >= at_least; s = strength(token_)) {
      const Token sign = token_;
      const char symbol = sign.text.front();
      advance();
      if (symbol == '*' && token_.is('*') && token_.offset == previous_.offset + 1) {
        fail(previous_.offset, "** is not an operator: use ^ for a power");
      }
      if (find_operator(symbol)->to_the_right) {
        const Nesting nesting(*this);
        const Operand exponent = parse_operators(s);
        check_shapes(sign, left, exponent);
        left = {pow(left.number, exponent.number)};
        continue;
      }
      const Operand right = parse_operators(s + 1);
      check_shapes(sign, left, right);
      left = by_component(left, right, [&](Expression a, Expression b) {
        return symbol == '+' ? a + b : symbol == '-' ? a - b : symbol == '*' ? a * b : a / b;
      });
    }
    return left;
  }

  void check_shapes(const Token& sign, const Operand& a, const Operand& b) const {
    if (const std::string reason = refusal(sign.text.front(), a, b); !reason.empty()) {
      fail(sign.offset, reason);
    }
  }

  Operand parse_operand() {
    const Token token = token_;
    switch (token.kind) {
      case Token::Kind::number: advance(); return finish_operand({graph_->constant(token.value)});
      case Token::Kind::name:
        advance();
        if (token_.is('(')) {
          return finish_operand({parse_called(token)});
        }
        if (token_.is('[')) {
          return finish_operand(parse_component(token));
        }
        if (vectors_ && find_bound(token.text) == nullptr && find_constant(token.text) == nullptr &&
            !context_.resolve(token.text)) {
          if (Operand vector{.vector = components(token.text)}; vector.is_vector()) {
            return finish_operand(std::move(vector));
          }
        }
        return finish_operand({resolve(token)});
      case Token::Kind::symbol:
        if (token.is('-')) {
          const Nesting nesting(*this);
          advance();
          Operand operand = parse_operators(strength_of_power);
          return by_component(operand, operand, [](Expression a, Expression) { return -a; });
        }
        if (token.is('(')) {
          const Nesting nesting(*this);
          advance();
          Operand inner = parse_operators(strength_of_sum);
          close(token.offset);
          return finish_operand(std::move(inner));
        }
        break;
      case Token::Kind::end: break;
    }
    refuse_missing_operand(text_, previous_, token_);
  }

  /// After an operand another one may not follow.
  Operand finish_operand(Operand operand) const {
    if (token_.kind == Token::Kind::number || token_.kind == Token::Kind::name || token_.is('(')) {
      refuse_after_operand();
    }
    return operand;
  }

  void close(std::size_t opening) {
    if (token_.is(')')) {
      advance();
      return;
    }
    if (token_.kind == Token::Kind::end) {
      fail(opening, "this ( is never closed");
    }
    refuse_after_operand();
  }

  // ---- components of vectors ----------------------------------------------------------------------------------------

  /// A name given by its sum: i = 3, or, while a loop is built, a variable.
  struct Bound {
    std::string_view name;
    double value;
    Expression variable = {};
  };
  [[nodiscard]] const Bound* find_bound(std::string_view name) const {
    const auto found = std::ranges::find(bound_, name, &Bound::name);
    return found == bound_.end() ? nullptr : &*found;
  }

  /// An integer that is known now: of numbers, parameters and the indices of sums.
  std::int64_t parse_integer(std::string_view what) {
    const std::size_t begin = token_.offset;
    const Expression value = parse_index(what);
    if (!value.is_constant()) {
      fail(begin, fmt::format("{} has to be known beforehand", what));
    }
    return integer(value);
  }

  /// The same, or, while a loop is built, a formula of the indices of its sums.
  Expression parse_index(std::string_view what) {
    const std::size_t begin = token_.offset;
    const Expression value = parse_number();
    constexpr double largest = 1e9;
    const bool is_known = value.is_constant() ? value.constant_value() == std::round(value.constant_value()) &&
                                                    std::abs(value.constant_value()) <= largest
                                              : loop_ != nullptr && loop_->is_of_indices(value);
    if (!is_known) {
      fail(begin, fmt::format("{} has to be an integer that is known beforehand{}", what,
                              value.is_constant() ? fmt::format(", and is {}", value.constant_value()) : ""));
    }
    return value;
  }

  /// A formula of the graph that is built, be it that of a loop.
  [[nodiscard]] Expression here(Expression known) const { return loop_ == nullptr ? known : loop_->import(known); }

  /// name [ index ]: r[i+1] is r2 where i is 1. Where vectors may stand, name [ from : to ]: r[1:2] is r1, r2.
  Operand parse_component(const Token& vector) {
    const Nesting nesting(*this);
    advance();
    const Expression index = parse_index("an index");
    std::optional<Expression> last;
    if (vectors_ && token_.is(':')) {
      advance();
      last = parse_index("an index");
    }
    if (token_.is(':')) {
      fail(token_.offset, "a part of a vector stands in norm and dot only");
    }
    if (!token_.is(']')) {
      fail(vector.offset + vector.text.size(), "this [ is never closed");
    }
    advance();
    if (!last) {
      return {component(vector, index)};
    }
    const auto distance =
        loop_ != nullptr ? loop_->distance(index, *last) : std::optional(integer(*last) - integer(index));
    if (!distance) {
      fail(vector.offset, "a part of a vector has to have a length that is known beforehand");
    }
    if (*distance < 0) {
      fail(vector.offset, fmt::format("{}[{}:{}] has no component", vector.text, to_string(index), to_string(*last)));
    }
    Operand part;
    for (std::int64_t i = 0; i <= *distance; ++i) {
      part.vector.push_back(component(vector, index + i));
    }
    return part;
  }

  [[nodiscard]] static std::int64_t integer(Expression known) {
    return static_cast<std::int64_t>(known.constant_value());
  }

  [[nodiscard]] Expression component(const Token& vector, Expression index) const {
    return index.is_constant() ? component(vector, integer(index)) : loop_->element(vector.text, index);
  }

  [[nodiscard]] Expression component(const Token& vector, std::int64_t index) const {
    const auto known = index < 0 ? std::nullopt : find_component(vector.text, index);
    if (!known) {
      fail(vector.offset, fmt::format("there is no {}[{}]", vector.text, index));
    }
    return here(*known);
  }

  /// Of r it is r1, r2, …; of r_dot r1_dot, …; of r_0 and r_1, at the ends of a step, r1_0, ….
  [[nodiscard]] std::optional<Expression> find_component(std::string_view vector, std::int64_t index) const {
    if (const auto known = context_.resolve(fmt::format("{}{}", vector, index))) {
      return known;
    }
    for (const std::string_view ending : {"_dot", "_0", "_1"}) {
      if (vector.ends_with(ending)) {
        return context_.resolve(fmt::format("{}{}{}", vector.substr(0, vector.size() - ending.size()), index, ending));
      }
    }
    return std::nullopt;
  }

  /// All of them: as far as there are names of one kind, so that a parameter r4 does not belong to coordinates r1 … r3.
  [[nodiscard]] std::vector<Expression> components(std::string_view vector) const {
    std::vector<Expression> found;
    const auto is_variable = [&](Expression x) { return x.graph()->node(x.index()).operation == Operation::variable; };
    bool variables = false;
    for (std::int64_t i = 1;; ++i) {
      const auto next = find_component(vector, i);
      if (!next || (!found.empty() && is_variable(*next) != variables)) {
        return found;
      }
      variables = is_variable(*next);
      found.push_back(here(*next));
    }
  }

  /// Whether the name is the word of the language: the caller that has something of that name means that.
  [[nodiscard]] bool is_free(const Token& token) const { return !context_.resolve(token.text); }

  Expression parse_called(const Token& called) {
    if (find_word(called.text) == nullptr || !is_free(called)) {
      return parse_call(called);
    }
    const Nesting nesting(*this);
    return called.text == "sum"     ? parse_sum(called)
           : called.text == "where" ? parse_where(called)
           : called.text == "norm"  ? parse_norm(called)
           : called.text == "dot"   ? parse_dot(called)
           : called.text == "mod"   ? parse_mod(called)
           : called.text == "noise" ? parse_noise(called)
                                    : parse_elliptic_integral(called);
  }

  /// The comma before the next argument.
  void comma(const Token& called, std::string_view usage) {
    if (!token_.is(',')) {
      if (token_.kind != Token::Kind::end && !token_.is(')')) {
        refuse_after_operand();
      }
      fail(called.offset, std::string(usage));
    }
    advance();
  }

  /// where ( a < b , f , g )
  Expression parse_where(const Token& called) {
    constexpr std::string_view usage = "where takes a comparison and two formulas: where(x > 0, x^2, 0)";
    const std::size_t opening = token_.offset;
    advance();
    const Expression left = parse_number();
    const Token sign = token_;
    if (!is_comparison(sign)) {
      if (sign.kind != Token::Kind::end && !sign.is(')') && !sign.is(',')) {
        refuse_after_operand();
      }
      fail(called.offset, std::string(usage));
    }
    advance();
    const Expression right = parse_number();
    if (is_comparison(token_)) {
      fail(token_.offset, "one comparison is a condition: for two write one where inside another");
    }
    comma(called, usage);
    const Expression chosen = parse_number();
    comma(called, usage);
    const Expression otherwise = parse_number();
    if (token_.is(',')) {
      fail(token_.offset, std::string(usage));
    }
    close(opening);
    const bool or_equal = sign.text.size() == 2;
    const Condition condition =
        sign.is('>') == or_equal ? Condition{right - left, or_equal} : Condition{left - right, or_equal};
    return where(condition, chosen, otherwise);
  }

  /// norm ( vector ), or of two or more numbers, from left to right.
  Expression parse_norm(const Token& called) {
    const std::size_t opening = token_.offset;
    advance();
    std::vector<Expression> parts = parse_vector();
    bool vector = parts.size() > 1;
    while (token_.is(',')) {
      advance();
      const std::vector<Expression> more = parse_vector();
      vector = vector || more.size() > 1;
      parts.insert(parts.end(), more.begin(), more.end());
      if (vector) {
        fail(called.offset, "norm takes one vector, or two or more numbers");
      }
    }
    close(opening);
    return parts.size() == 1 ? abs(parts.front()) : sqrt(scalar_product(parts, parts));
  }

  /// mod ( x , y )
  Expression parse_mod(const Token& called) {
    constexpr std::string_view usage = "mod takes two numbers: mod(x, y)";
    const std::size_t opening = token_.offset;
    advance();
    const Expression x = parse_number();
    comma(called, usage);
    const Expression y = parse_number();
    if (token_.is(',')) {
      fail(token_.offset, std::string(usage));
    }
    close(opening);
    return x - y * floor(x / y);
  }

  /// dot ( vector , vector )
  Expression parse_dot(const Token& called) {
    constexpr std::string_view usage = "dot takes two vectors: dot(r, s)";
    const std::size_t opening = token_.offset;
    advance();
    const std::vector<Expression> first = parse_vector();
    comma(called, usage);
    const std::vector<Expression> second = parse_vector();
    if (token_.is(',')) {
      fail(token_.offset, std::string(usage));
    }
    close(opening);
    if (first.size() != second.size()) {
      fail(called.offset, fmt::format("dot takes two vectors of one length, and these have {} and {} components",
                                      first.size(), second.size()));
    }
    return scalar_product(first, second);
  }

  /// noise ( seed ): a number. noise ( seed , waves ) is the caller's, if there is a domain.
  Expression parse_noise(const Token& called) {
    const std::size_t opening = token_.offset;
    advance();
    const std::int64_t seed = parse_integer("the seed of noise");
    if (!token_.is(',')) {
      close(opening);
      return graph_->constant(Draws(static_cast<std::uint64_t>(seed)).normal(0, 0));
    }
    advance();
    const std::array arguments{graph_->constant(static_cast<double>(seed)),
                               graph_->constant(static_cast<double>(parse_integer("the number of waves")))};
    close(opening);
    if (const auto result = call(called, arguments)) {
      return *result;
    }
    fail(called.offset,
         "noise(seed, waves) is a function of x in [initial] and S of a lattice; noise(seed) is a number");
  }

  /// What the caller has for the name; what it refuses is wrong there.
  std::optional<Expression> call(const Token& called, std::span<const Expression> arguments) const {
    if (loop_ != nullptr) {
      throw NotALoop("a function of the problem");
    }
    try {
      return context_.call ? context_.call(called.text, arguments) : std::nullopt;
    } catch (const ParseError&) {
      throw;
    } catch (const std::invalid_argument& error) {
      fail(called.offset, error.what());
    }
  }

  /// ellipk ( m ) and ellipe ( m ), numbers.
  Expression parse_elliptic_integral(const Token& called) {
    const std::size_t opening = token_.offset;
    advance();
    const std::size_t begin = token_.offset;
    const Expression m = parse_number();
    close(opening);
    const double value = !m.is_constant()          ? std::numeric_limits<double>::quiet_NaN()
                         : called.text == "ellipk" ? elliptic_k(m.constant_value())
                                                   : elliptic_e(m.constant_value());
    if (!std::isfinite(value)) {
      fail(begin, fmt::format("m of {} has to be a number that is known beforehand, from 0 to 1{}{}", called.text,
                              called.text == "ellipk" ? " and not 1" : "",
                              m.is_constant() ? fmt::format(", and is {}", m.constant_value()) : ""));
    }
    return graph_->constant(value);
  }

  /// The beginning of a sum: sum ( index ,
  Token parse_index_name(const Token& called) {
    advance();
    const Token index = token_;
    if (index.kind != Token::Kind::name) {
      fail(index.offset, "sum begins with the name of its index: sum(i, 1, 10, q[i]^2)");
    }
    if (is_reserved_name(index.text) || context_.resolve(index.text) || find_bound(index.text) != nullptr) {
      fail(index.offset,
           fmt::format("'{}' has a meaning already: give the index of this sum another name", index.text));
    }
    advance();
    next_of_sum(called);
    return index;
  }

  void next_of_sum(const Token& called) {
    if (!token_.is(',')) {
      fail(called.offset, "sum takes an index, where it begins, where it ends, and a term: sum(i, 1, 10, q[i]^2)");
    }
    advance();
  }

  void close_sum(std::size_t opening) {
    if (token_.is(',')) {
      fail(token_.offset, "sum takes one term");
    }
    close(opening);
  }

  /// sum ( index , from , to , term ): a loop, whose term is read once; if it is short, or no loop, the term is read
  /// for every value of the index.
  Expression parse_sum(const Token& called) {
    if (loop_ != nullptr) {
      return parse_sum_of_loop(called);
    }
    const Parser before(*this);
    const std::size_t opening = token_.offset;
    const Token index = parse_index_name(called);
    const std::int64_t first = parse_integer("the first index");
    next_of_sum(called);
    const std::int64_t last = parse_integer("the last index");
    next_of_sum(called);
    const Token term = token_, begin = previous_;
    if (const bool has_sums = skip_argument(); has_sums || last - first >= std::int64_t{LoopBuilder::shortest_loop}) {
      if (const auto loop = parse_loop(called, before)) {
        return *loop;
      }
    }
    std::vector<Expression> summands;
    for (std::int64_t i = first; i <= last; ++i) {
      if (++terms_ > most_terms) {
        fail(called.offset, fmt::format("more than {} terms in the sums of one formula", most_terms));
      }
      token_ = term;
      previous_ = begin;
      bound_.push_back({index.text, static_cast<double>(i)});
      summands.push_back(parse_number());
      bound_.pop_back();
    }
    close_sum(opening);
    return summands.empty() ? graph_->constant(0.0) : folded_sum(std::move(summands));
  }

  /// The sum that begins where `before` stands as a loop; none if it is not to be one.
  std::optional<Expression> parse_loop(const Token& called, const Parser& before) {
    try {
      LoopBuilder loop(*graph_);
      Parser inner(before);
      inner.loop_ = &loop;
      inner.graph_ = &loop.graph();
      const Expression sum = inner.parse_sum_of_loop(called);
      const auto result =
          loop.finish(sum, [&](std::string_view vector, std::int64_t i) { return find_component(vector, i); });
      if (result) {
        token_ = inner.token_;
        previous_ = inner.previous_;
      }
      return result;
    } catch (const NotALoop&) {
    } catch (const ParseError&) {  // found again where the terms are read one by one
    }
    return std::nullopt;
  }

  Expression parse_sum_of_loop(const Token& called) {
    const std::size_t opening = token_.offset;
    const Token name = parse_index_name(called);
    const Expression first = parse_index("the first index");
    next_of_sum(called);
    const Expression last = parse_index("the last index");
    next_of_sum(called);
    const Expression index = loop_->new_index();
    bound_.push_back({name.text, 0.0, index});
    const Expression term = parse_number();
    bound_.pop_back();
    close_sum(opening);
    return loop_->sum(index, first, last, term);
  }

  /// Of an empty sum names need not exist. \return whether there is a sum in it
  bool skip_argument() {
    bool has_sums = false;
    for (int depth = 0; token_.kind != Token::Kind::end && (depth > 0 || !(token_.is(')') || token_.is(',')));
         advance()) {
      depth += token_.is('(') ? 1 : token_.is(')') ? -1 : 0;
      has_sums = has_sums || (token_.kind == Token::Kind::name && token_.text == "sum");
    }
    return has_sums;
  }

  // ---- names and calls ----------------------------------------------------------------------------------------------

  Expression resolve(const Token& token) {
    if (const Bound* const bound = find_bound(token.text)) {
      return bound->variable.valid() ? bound->variable : graph_->constant(bound->value);
    }
    if (const Constant* const constant = find_constant(token.text)) {
      return graph_->constant(constant->value);
    }
    if (const auto known = context_.resolve(token.text)) {
      return here(*known);
    }
    refuse_name(text_, token, context_.known_names);
  }

  /// name ( argument {, argument} )
  Expression parse_call(const Token& called) {
    const Nesting nesting(*this);
    const std::size_t opening = token_.offset;
    const Function* function = find_function(called.text);
    if (function != nullptr && function->yields && !is_free(called)) {
      function = nullptr;
    }
    if (function == nullptr && !context_.call) {
      refuse_call(called);
    }
    advance();
    std::vector<Expression> arguments;
    if (!token_.is(')')) {
      arguments.push_back(parse_number());
      while (token_.is(',')) {
        advance();
        arguments.push_back(parse_number());
      }
    }
    close(opening);
    if (function == nullptr) {
      if (const auto result = call(called, arguments)) {
        return *result;
      }
      refuse_call(called);
    }
    return apply_function(called, *function, arguments);
  }

  Expression apply_function(const Token& called, const Function& function, std::span<const Expression> arguments) {
    const auto expected = static_cast<std::size_t>(arity(function.operation));
    if (function.variadic ? arguments.size() < expected : arguments.size() != expected) {
      fail(called.offset,
           fmt::format("{} takes {}{} argument{}, got {}", function.name, expected, function.variadic ? " or more" : "",
                       expected == 1 && !function.variadic ? "" : "s", arguments.size()));
    }
    if (expected == 1) {
      return graph_->make(function.operation, arguments[0]);
    }
    Expression result = arguments[0];
    try {
      for (const Expression argument : arguments.subspan(1)) {
        result = graph_->make(function.operation, result, argument);
      }
    } catch (const std::invalid_argument& error) {  // of the order of a Bessel function, or the parameter m
      fail(called.offset, error.what());
    }
    return result;
  }

  [[noreturn]] void refuse_call(const Token& called) const {
    if (find_constant(called.text) != nullptr || context_.resolve(called.text)) {
      fail(called.offset, fmt::format("'{0}' is not a function: for a product write {0}*(...)", called.text));
    }
    refuse_function(text_, called, context_.known_names);
  }
  [[noreturn]] void refuse_after_operand() const { formula::refuse_after_operand(text_, previous_, token_); }

  std::string_view text_;
  Graph* graph_;
  const ParseContext& context_;
  Token token_;
  Token previous_;
  int depth_ = 0;
  bool vectors_ = false;  ///< whether a name may be that of a vector: in norm and dot
  std::vector<Bound> bound_;
  std::size_t terms_ = 0;
  LoopBuilder* loop_ = nullptr;  ///< of the outermost sum, while it is read as one
};

}  // namespace

Expression parse(std::string_view text, Graph& graph, const ParseContext& context) {
  if (!context.resolve) {
    throw std::invalid_argument("parse: the context has no resolver of names");
  }
  return Parser(text, graph, context).parse_all();
}

Expression parse(std::string_view text, Graph& graph, std::span<const std::string> names) {
  const std::unordered_set<std::string_view> known(names.begin(), names.end());
  const ParseContext context{.resolve = [&](std::string_view name) -> std::optional<Expression> {
                               return known.contains(name) ? std::optional(graph.variable(name)) : std::nullopt;
                             },
                             .known_names = names};
  return parse(text, graph, context);
}

}  // namespace rubato::formula
