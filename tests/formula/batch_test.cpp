#include <algorithm>
#include <bit>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <random>
#include <rubato/base/lanes.hpp>
#include <rubato/formula/batch.hpp>
#include <rubato/formula/batch_kernel.hpp>
#include <string>
#include <thread>
#include <vector>

namespace {

using namespace rubato::formula;
using Column = std::vector<double>;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

std::int64_t ordered(double x) {
  const auto bits = std::bit_cast<std::int64_t>(x);
  return bits < 0 ? std::numeric_limits<std::int64_t>::min() - bits : bits;
}

/// Doubles between two values; 0 for NaN and NaN; infinite for NaN and a number, infinity and a number, and 0 and -0.
double ulp_distance(double a, double b) {
  if (std::isnan(a) && std::isnan(b))
    return 0.0;
  if (std::isnan(a) || std::isnan(b) || std::isinf(a) != std::isinf(b) ||
      (a == b && std::signbit(a) != std::signbit(b)))
    return infinity;
  const auto [low, high] = std::minmax({ordered(a), ordered(b)});
  return static_cast<double>(static_cast<std::uint64_t>(high) - static_cast<std::uint64_t>(low));
}

/// Bit for bit, except that one NaN is as good as another: which of two NaN a sum passes on depends on the order in
/// which the compiler put its operands.
bool same_bits(const Column& a, const Column& b) {
  return std::ranges::equal(a, b, [](double x, double y) {
    return std::bit_cast<std::uint64_t>(x) == std::bit_cast<std::uint64_t>(y) || (std::isnan(x) && std::isnan(y));
  });
}

std::vector<Column> batched(const Bytecode& code, const std::vector<Column>& inputs, std::size_t first,
                            std::size_t last, BatchFunctions functions = BatchFunctions::vector) {
  BatchEvaluator evaluator(code, Engine::automatic, functions);
  std::vector<Column> outputs(code.output_count(), Column(last - first));
  std::vector<const double*> in;
  std::vector<double*> out;
  for (const Column& column : inputs)
    in.push_back(column.data() + first);
  for (Column& column : outputs)
    out.push_back(column.data());
  evaluator(last - first, in, out);
  return outputs;
}

std::vector<Column> batched(const Bytecode& code, const std::vector<Column>& inputs) {
  return batched(code, inputs, 0, inputs.front().size());
}

std::vector<Column> one_by_one(const Bytecode& code, const std::vector<Column>& inputs) {
  ScalarEvaluator evaluator(code);
  std::vector<Column> outputs(code.output_count(), Column(inputs.front().size()));
  for (std::size_t i = 0; i < inputs.front().size(); ++i) {
    for (std::size_t m = 0; m < inputs.size(); ++m)
      evaluator.inputs()[m] = inputs[m][i];
    evaluator.run();
    for (std::size_t j = 0; j < outputs.size(); ++j)
      outputs[j][i] = evaluator.output(j);
  }
  return outputs;
}

/// Specials, numbers of every size, and a dense sample of the moderate ones.
Column arguments() {
  Column x = {0.0,    -0.0,   infinity, -infinity, not_a_number, 1.0,       -1.0,  0.5,    -0.5,   2.0,
              -2.0,   5e-324, -5e-324,  1e-310,    -1e-310,      0x1p-1022, 1e300, -1e300, 1e-300, -1e-300,
              1e22,   -1e22,  99999.9,  1e5,       100000.1,     707.9,     708.1, -707.9, -708.1, 709.5,
              -709.5, 711.0,  -711.0,   744.0,     -744.0,       746.0,     -746.0};
  for (int quarter = -40; quarter <= 40; ++quarter)  // next to the zeros and poles of the trigonometric functions
    x.push_back(quarter * 0.25 * M_PI);
  for (int n = 1; n < 60000; n += 997)
    x.push_back(n * M_PI_2);
  std::mt19937_64 random(20240607);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  std::uniform_real_distribution<double> exponent(-700.0, 700.0);
  for (int i = 0; i < 20000; ++i) {
    x.push_back(unit(random));
    x.push_back(5.0 * unit(random));
    x.push_back(800.0 * unit(random));
    x.push_back(1.1e5 * unit(random));
    x.push_back(std::copysign(std::exp(exponent(random)), unit(random)));
  }
  return x;
}

struct Bounded {
  std::string name;
  Expression (*function)(Expression);
  double ulps;  ///< as documented in batch.hpp
};

const std::vector<Bounded>& unary_functions() {
  static const std::vector<Bounded> functions = {{"negate", [](Expression x) { return -x; }, 0},
                                                 {"square", [](Expression x) { return x * x; }, 0},
                                                 {"power 7", [](Expression x) { return pow(x, 7.0); }, 0},
                                                 {"power -13", [](Expression x) { return pow(x, -13.0); }, 0},
                                                 {"sqrt", sqrt, 0},
                                                 {"abs", abs, 0},
                                                 {"sign", sign, 0},
                                                 {"sin", sin, 2},
                                                 {"cos", cos, 2},
                                                 {"tan", tan, 3},
                                                 {"asin", asin, 1},
                                                 {"acos", acos, 1},
                                                 {"atan", atan, 2},
                                                 {"sinh", sinh, 2},
                                                 {"cosh", cosh, 2},
                                                 {"tanh", tanh, 2},
                                                 {"sech", sech, 2},
                                                 {"csch", csch, 3},
                                                 {"asinh", asinh, 1},
                                                 {"acosh", acosh, 1},
                                                 {"atanh", atanh, 2},
                                                 {"exp", exp, 1},
                                                 {"log", log, 1},
                                                 {"cbrt", cbrt, 3}};
  return functions;
}

Bytecode compile(std::initializer_list<Expression> outputs, std::initializer_list<Expression> inputs) {
  return Bytecode(std::vector<Expression>(outputs), std::vector<Expression>(inputs));
}

/// A gradient with most operations in it, for the tests about positions and kernels.
Bytecode mixed_code() {
  Graph graph;
  const Expression x = graph.variable("x");
  const Expression y = graph.variable("y");
  const Expression f = sin(x * y) * exp(-x * x) + cos(x * y) * tanh(y) + sqrt(abs(x) + 1) / (2 + y * y) + atan2(y, x);
  const Expression g = tan(x) + log(abs(y)) + cbrt(x - y) + sech(x) * asinh(y) + min(x, y) - max(x * x, y);
  return compile({f, g, x * y + f, x, f}, {x, y});
}

std::vector<Column> mixed_points() {
  const Column all = arguments();
  std::vector<Column> points(2);
  for (std::size_t i = 0; i < 4001; ++i) {
    points[0].push_back(all[i]);
    points[1].push_back(all[(7 * i + 3) % all.size()]);
  }
  return points;
}

}  // namespace

TEST_CASE("batches agree with the scalar evaluator to the documented number of ulps") {
  const Column x = arguments();
  for (const Bounded& f : unary_functions()) {
    Graph graph;
    const Expression variable = graph.variable("x");
    const Bytecode code = compile({f.function(variable)}, {variable});
    const Column expected = one_by_one(code, {x})[0];
    const Column found = batched(code, {x})[0];
    double worst = 0.0;
    double at = 0.0;
    for (std::size_t i = 0; i < x.size(); ++i)
      if (const double distance = ulp_distance(found[i], expected[i]); distance > worst) {
        worst = distance;
        at = x[i];
      }
    INFO(f.name << " at " << at);
    CHECK(worst <= f.ulps);
  }
}

TEST_CASE("the ulp distance sees what must not happen") {
  CHECK(ulp_distance(1.0, std::nextafter(1.0, 2.0)) == 1.0);
  CHECK(ulp_distance(-5e-324, 5e-324) == 2.0);
  CHECK(ulp_distance(not_a_number, not_a_number) == 0.0);
  CHECK(ulp_distance(not_a_number, 1.0) == infinity);
  CHECK(ulp_distance(infinity, 1e308) == infinity);
  CHECK(ulp_distance(0.0, -0.0) == infinity);
  // One quadrant lost, as after a wrong reduction of the angle.
  CHECK(ulp_distance(std::sin(5.0), std::sin(5.0 + M_PI_2)) > 1e10);
}

TEST_CASE("operations of two and three arguments are bit for bit those of the scalar evaluator") {
  const Column all = arguments();
  std::vector<Column> inputs(3);
  for (std::size_t i = 0; i < all.size(); ++i) {
    inputs[0].push_back(all[i]);
    inputs[1].push_back(all[(11 * i + 5) % all.size()]);
    inputs[2].push_back(all[(29 * i + 1) % all.size()]);
  }
  Graph graph;
  const Expression x = graph.variable("x");
  const Expression y = graph.variable("y");
  const Expression z = graph.variable("z");
  for (const Expression e : {x + y, x - y, x * y, x / y, pow(x, y), atan2(x, y), min(x, y), max(x, y), x * y + z,
                             x * y - z, z - x * y, x * x + z}) {
    const Bytecode code = compile({e}, {x, y, z});
    const Column expected = one_by_one(code, inputs)[0];
    const Column found = batched(code, inputs)[0];
    double worst = 0.0;
    for (std::size_t i = 0; i < expected.size(); ++i)
      worst = std::max(worst, ulp_distance(found[i], expected[i]));
    INFO(to_string(e));
    CHECK(worst == 0.0);
  }
}

TEST_CASE("with the scalar evaluator's functions every result is the scalar evaluator's") {
  const Column x = arguments();
  std::size_t others = 0;
  for (const Bounded& f : unary_functions()) {
    Graph graph;
    const Expression variable = graph.variable("x");
    const Bytecode code = compile({f.function(variable), 2.0 * f.function(variable * variable) + variable}, {variable});
    const std::vector<Column> expected = one_by_one(code, {x});
    const std::vector<Column> found = batched(code, {x}, 0, x.size(), BatchFunctions::scalar);
    INFO(f.name);
    CHECK(same_bits(found[0], expected[0]));
    CHECK(same_bits(found[1], expected[1]));
    others += same_bits(batched(code, {x})[0], expected[0]) ? 0 : 1;
  }
  CHECK(others > 5);  // the vector functions give other bits
  const std::vector<Column> points = mixed_points();
  const std::vector<Column> expected = one_by_one(mixed_code(), points);
  const std::vector<Column> found = batched(mixed_code(), points, 0, points[0].size(), BatchFunctions::scalar);
  for (std::size_t j = 0; j < expected.size(); ++j) {
    CHECK(same_bits(found[j], expected[j]));
  }
}

TEST_CASE("sine and cosine taken together are those taken alone") {
  const Column x = arguments();
  Graph graph;
  const Expression variable = graph.variable("x");
  const Bytecode together = compile({sin(variable), cos(variable)}, {variable});
  REQUIRE(together.instructions().size() == 1);
  const auto both = batched(together, {x});
  CHECK(same_bits(both[0], batched(compile({sin(variable)}, {variable}), {x})[0]));
  CHECK(same_bits(both[1], batched(compile({cos(variable)}, {variable}), {x})[0]));
  CHECK_FALSE(same_bits(both[0], both[1]));
}

TEST_CASE("products are rounded before they are added") {
  // (1+ε)(1-ε) - 1 with ε = 2^-30: the product rounds to 1, a fused operation would keep -ε².
  Graph graph;
  const Expression x = graph.variable("x");
  const Expression y = graph.variable("y");
  const Bytecode code = compile({x * y - 1.0, x * y + (-1.0), 1.0 - x * y}, {x, y});
  const auto found = batched(code, {Column(9, 1.0 + 0x1p-30), Column(9, 1.0 - 0x1p-30)});
  for (const Column& column : found)
    for (const double value : column)
      CHECK(value == 0.0);
  CHECK(std::fma(1.0 + 0x1p-30, 1.0 - 0x1p-30, -1.0) != 0.0);
}

TEST_CASE("a point's result does not depend on its place, its neighbours or the splitting of the range") {
  const Bytecode code = mixed_code();
  const auto points = mixed_points();
  const std::size_t count = points[0].size();
  const auto whole = batched(code, points);
  std::mt19937 random(7);
  for (int trial = 0; trial < 40; ++trial) {
    const std::size_t first = random() % count;
    const std::size_t last = first + 1 + random() % std::min<std::size_t>(count - first, trial < 20 ? 20 : 600);
    const auto piece = batched(code, points, first, last);
    for (std::size_t j = 0; j < whole.size(); ++j)
      CHECK(same_bits(piece[j], Column(whole[j].begin() + static_cast<std::ptrdiff_t>(first),
                                       whole[j].begin() + static_cast<std::ptrdiff_t>(last))));
  }
  // Every point among copies of itself, without neighbours that could choose its path.
  for (std::size_t i = 0; i < 300; ++i) {
    const auto alone = batched(code, {Column(8, points[0][i]), Column(8, points[1][i])});
    for (std::size_t j = 0; j < whole.size(); ++j)
      CHECK(same_bits(alone[j], Column(8, whole[j][i])));
  }
  // The comparison sees one bit.
  Column other = whole[0];
  other[1000] = std::nextafter(other[1000], 0.0);
  CHECK_FALSE(same_bits(whole[0], other));
  CHECK_FALSE(same_bits({0.0}, {-0.0}));
  CHECK_FALSE(same_bits({not_a_number}, {1.0}));
}

TEST_CASE("at places that stay points are evaluated as anywhere, and again when these have changed") {
  Graph graph;
  const Expression x = graph.variable("x"), y = graph.variable("y");
  const std::vector<Expression> arithmetic = {x * y + 1.0, y, x / y - x, constant_like(x, 3.0), x * y + 1.0},
                                functions = {sin(x) * y, x, exp(y) - x, sin(x) * y, x * x}, none = {y, x};
  const std::array variables{x, y};
  for (const auto& formulas : {arithmetic, functions, none}) {
    const Bytecode code(formulas, variables);
    for (const Engine engine : {Engine::automatic, Engine::interpreter}) {
      for (const std::size_t points : {1UL, 2UL, 3UL, 4UL, 8UL, 12UL, 16UL, 256UL}) {
        std::vector<Column> inputs(2, Column(points)), outputs(formulas.size(), Column(points)), expected = outputs;
        std::vector<const double*> in;
        std::vector<double*> out, other;
        for (std::size_t j = 0; j < formulas.size(); ++j) {
          out.push_back(outputs[j].data());
          other.push_back(expected[j].data());
        }
        for (const Column& column : inputs) {
          in.push_back(column.data());
        }
        BatchEvaluator bound(code, engine), free(code, engine);
        bound.bind(points, in, out);
        for (int turn = 0; turn < 4; ++turn) {
          INFO(points << " points, turn " << turn);
          for (std::size_t i = 0; i < points; ++i) {
            inputs[0][i] = 0.3 + static_cast<double>(i) + turn;
            inputs[1][i] = 1.7 - 0.01 * static_cast<double>(i) * turn;
          }
          if (turn == 2) {  // elsewhere in between
            std::vector<Column> elsewhere(formulas.size(), Column(points));
            std::vector<double*> there;
            for (Column& column : elsewhere) {
              there.push_back(column.data());
            }
            bound(points, in, there);
          }
          BatchEvaluator copy(bound);
          (turn == 3 ? copy : bound).run();
          free(points, in, other);
          for (std::size_t j = 0; j < formulas.size(); ++j) {
            CHECK(same_bits(outputs[j], expected[j]));
          }
          const Column before = outputs[0];
          inputs[1][points - 1] += 1.0;  // the twin: what is not evaluated again stays
          CHECK(same_bits(outputs[0], before));
          bound.run();
          CHECK_FALSE(same_bits(outputs[0], before));
        }
      }
    }
  }
}

TEST_CASE("threads with an evaluator each get what one thread gets") {
  const Bytecode code = mixed_code();
  const auto points = mixed_points();
  const auto whole = batched(code, points);
  std::vector<std::vector<Column>> pieces(3);
  std::vector<std::thread> threads;
  for (std::size_t part = 0; part < 3; ++part)
    threads.emplace_back([&, part] { pieces[part] = batched(code, points, part * 4001 / 3, (part + 1) * 4001 / 3); });
  for (std::thread& thread : threads)
    thread.join();
  for (std::size_t j = 0; j < whole.size(); ++j) {
    Column joined;
    for (const auto& piece : pieces)
      joined.insert(joined.end(), piece[j].begin(), piece[j].end());
    CHECK(same_bits(joined, whole[j]));
  }
}

namespace {

/// Outputs of `code` by one kernel; the inputs are whole blocks.
std::vector<Column> by_kernel(const batch::NamedKernel& kernel, const Bytecode& code,
                              const std::vector<Column>& inputs) {
  std::vector<Column> registers(code.register_count(), Column(batch::block_points));
  std::vector<const double*> read;
  std::vector<double*> write;
  for (Column& column : registers) {
    read.push_back(column.data());
    write.push_back(column.data());
  }
  for (std::size_t c = 0; c < code.constants().size(); ++c)
    std::ranges::fill(registers[code.input_count() + c], code.constants()[c]);
  std::vector<Column> found(code.output_count());
  for (std::size_t start = 0; start < inputs[0].size(); start += batch::block_points) {
    for (std::size_t m = 0; m < inputs.size(); ++m)
      std::copy_n(inputs[m].data() + start, batch::block_points, registers[m].data());
    const auto instructions = code.instructions();
    kernel.run({batch::block_points, instructions.data(), instructions.data() + instructions.size(), read.data(),
                write.data()});
    for (std::size_t j = 0; j < found.size(); ++j) {
      const Column& column = registers[code.outputs()[j]];
      found[j].insert(found[j].end(), column.begin(), column.end());
    }
  }
  return found;
}

/// Every function of one argument, by itself.
Bytecode all_unary_code() {
  Graph graph;
  const Expression x = graph.variable("x");
  std::vector<Expression> outputs;
  for (const Bounded& f : unary_functions())
    outputs.push_back(f.function(x));
  return Bytecode(outputs, std::vector<Expression>{x});
}

/// Every operation of two arguments, and the fused and repeated ones that the compiler makes of them.
Bytecode arithmetic_code() {
  Graph graph;
  const Expression x = graph.variable("x");
  const Expression y = graph.variable("y");
  return compile({x + y, x - y, x * y, x / y, -x, x * y + x, x * y - y, y - x * y, x * x, pow(x, 5), pow(x, -3),
                  pow(y, 7) * x, pow(x, y), atan2(x, y), min(x, y), max(x, y)},
                 {x, y});
}

}  // namespace

TEST_CASE("all instruction sets of this machine give the same bits") {
  for (const Bytecode& code : {all_unary_code(), arithmetic_code(), mixed_code()}) {
    std::vector<Column> inputs = code.input_count() == 1 ? std::vector<Column>{arguments()} : mixed_points();
    for (Column& column : inputs)
      column.resize(column.size() / batch::block_points * batch::block_points);
    const auto expected = batched(code, inputs);
    for (const batch::NamedKernel& kernel : batch::kernels()) {
      if (!kernel.supported) {
        WARN("not tested, this machine has no " << kernel.name);
        continue;
      }
      const auto found = by_kernel(kernel, code, inputs);
      for (std::size_t j = 0; j < found.size(); ++j) {
        INFO(kernel.name << ", output " << j << " of " << found.size());
        CHECK(same_bits(found[j], expected[j]));
      }
    }
  }
  // The batches use the widest of them, unless the environment asks for less.
  std::string_view widest;
  for (const batch::NamedKernel& kernel : batch::kernels())
    if (kernel.supported && (rubato::lanes_asked_for() == 0 || kernel.lanes <= rubato::lanes_asked_for()))
      widest = kernel.name;
  CHECK(simd_name() == widest);
}

TEST_CASE("sech and csch of huge arguments are zeros, never NaN") {
  Graph graph;
  const Expression x = graph.variable("x");
  const Bytecode code = compile({sech(x), csch(x)}, {x});
  const Column huge = {800.0, -800.0, 1e10, -1e10, 1e300, -1e300, infinity, -infinity};
  const auto found = batched(code, {huge});
  for (std::size_t i = 0; i < huge.size(); ++i) {
    CHECK(ulp_distance(found[0][i], 0.0) == 0.0);
    CHECK(ulp_distance(found[1][i], std::copysign(0.0, huge[i])) == 0.0);
  }
  // The formulas that would not do.
  CHECK(std::isnan(2 * std::exp(800.0) / (std::exp(1600.0) + 1)));
}

TEST_CASE("inputs, constants and repeated formulas may be outputs, and empty batches are nothing") {
  Graph graph;
  const Expression x = graph.variable("x");
  const Expression y = graph.variable("y");
  const Bytecode code = compile({x, graph.constant(3.5), x + y, x + y, y}, {x, y});
  for (const std::size_t count : {0, 1, 7, 8, 255, 256, 257, 1000}) {
    std::vector<Column> inputs(2, Column(count));
    for (std::size_t i = 0; i < count; ++i) {
      inputs[0][i] = static_cast<double>(i);
      inputs[1][i] = 0.25 * static_cast<double>(i) - 1;
    }
    const auto found = batched(code, inputs);
    CHECK(same_bits(found[0], inputs[0]));
    CHECK(same_bits(found[1], Column(count, 3.5)));
    CHECK(same_bits(found[2], one_by_one(code, inputs)[2]));
    CHECK(same_bits(found[3], found[2]));
    CHECK(same_bits(found[4], inputs[1]));
  }
}
