#include <rubato/formula/rolled_code.hpp>

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include <rubato/formula/assemble.hpp>

namespace rubato::formula {

namespace {

using ValueNumber = std::uint32_t;
constexpr std::uint32_t not_there = RolledCode::none;
/// Code that is shorter is made straight: it takes some ten nanoseconds.
constexpr std::size_t shortest_rolled = 100;
/// More loops than these, each with code of its own, would take longer to make than straight code.
constexpr std::size_t most_loops = 64;

/// What makes a value, but for where: the operation and the shapes of its operands, with their distances.
struct Shape {
  OpCode code;
  std::uint32_t detail;  ///< the exponent of a whole power; which result of several
  std::array<std::uint32_t, 3> operands;
  std::array<std::int32_t, 3> distances;
  bool operator==(const Shape&) const = default;
};
struct ShapeHash {
  std::size_t operator()(const Shape& shape) const {
    std::uint64_t hash = static_cast<std::uint64_t>(shape.code) << 32U | shape.detail;
    const auto mix = [&](std::uint32_t word) { hash = (hash ^ word) * 0x9e3779b97f4a7c15U; };
    for (const std::uint32_t operand : shape.operands) {
      mix(operand);
      hash ^= hash >> 29U;
    }
    for (const std::int32_t distance : shape.distances) {
      mix(static_cast<std::uint32_t>(distance));
      hash ^= hash >> 29U;
    }
    return static_cast<std::size_t>(hash ^ hash >> 32U);
  }
};

/// Values of one shape at consecutive places.
struct Run {
  std::vector<ValueNumber> values;
  std::int64_t first_anchor = 0;
  bool in_lanes = false;
  bool is_output = false;
  bool kept = false;                  ///< for others, who read it; what is not is made anew where it is needed
  double work = 0.0;                  ///< to make a member of what is kept, in sums
  double reads = 0.0;                 ///< of a member, by loops that do not make it
  double single_reads = 0.0;          ///< of members, by single instructions
  std::uint32_t level = 0;            ///< of the loop that makes it
  std::uint32_t level_elsewhere = 0;  ///< of one that makes it anew for others
  std::uint32_t last_phase = 0;
};

struct Body {
  std::vector<std::uint32_t> instructions;
  std::vector<std::uint32_t> read;  ///< runs, from where they are kept
};

class Rolling {
public:
  Rolling(const Bytecode& code, const SingleAssignment& assigned, int lanes)
      : code_(code),
        assigned_(assigned),
        lanes_(static_cast<std::size_t>(lanes)),
        fixed_(code.input_count() + code.constants().size()),
        count_(fixed_ + assigned.maker.size()) {}

  std::optional<RolledCode> roll() {
    if (code_.instructions().size() < shortest_rolled) {
      return std::nullopt;
    }
    find_common();
    find_shapes();
    find_runs();
    std::size_t covered = 0;
    for (const Run& run : runs_) {
      covered += run.in_lanes ? run.values.size() : 0;
    }
    if (2 * covered < code_.instructions().size()) {
      return std::nullopt;
    }
    find_needs();
    place_runs();
    find_loops();
    if (loops_.size() > most_loops) {
      return std::nullopt;
    }
    find_outputs();
    find_single();
    find_kept();
    place_kept();
    write_phases();
    return std::move(result_);
  }

private:
  // ---- shapes and runs

  /// Inputs that a vector's worth of instructions reads, and many times as many as read the others: the length of a
  /// step in all that it moves. They are the same for all members of a run.
  void find_common() {
    std::vector<std::size_t> reads(code_.input_count(), 0);
    for (std::size_t i = 0; i < code_.instructions().size(); ++i) {
      for (std::size_t k = 0; k < operands_of(i); ++k) {
        if (const ValueNumber v = assigned_.steps[i].operands[k]; v < reads.size()) {
          ++reads[v];
        }
      }
    }
    const auto all = static_cast<double>(std::accumulate(reads.begin(), reads.end(), std::size_t{0}));
    const auto read = reads.size() - static_cast<std::size_t>(std::ranges::count(reads, std::size_t{0}));
    result_.common.resize(reads.size());
    for (std::size_t v = 0; v < reads.size(); ++v) {
      result_.common[v] = reads[v] >= lanes_ && static_cast<double>(reads[v] * read) > many_times * all;
    }
  }

  void find_shapes() {
    const std::size_t inputs = code_.input_count();
    shape_.resize(count_);
    anchor_.assign(count_, 0);
    is_anchored_.assign(count_, false);
    for (ValueNumber v = 0; v < fixed_; ++v) {
      const bool one_of_many = v < inputs && !result_.common[v];
      shape_[v] = one_of_many ? 0 : v + 1;
      anchor_[v] = one_of_many ? static_cast<std::int32_t>(v) : 0;
      is_anchored_[v] = one_of_many;
    }
    shapes_ = static_cast<std::uint32_t>(fixed_ + 1);
    std::unordered_map<Shape, std::uint32_t, ShapeHash> known;
    known.reserve(64);
    const auto instructions = code_.instructions();
    for (std::size_t i = 0; i < instructions.size(); ++i) {
      const SingleAssignment::Step& step = assigned_.steps[i];
      const OpCode operation = instructions[i].code;
      Shape shape{.code = operation, .detail = 0, .operands = {not_there, not_there, not_there}, .distances = {}};
      bool anchored = false;
      std::int32_t anchor = std::numeric_limits<std::int32_t>::max();
      for (std::size_t k = 0; k < operands_of(i); ++k) {
        const ValueNumber operand = step.operands[k];
        shape.operands[k] = shape_[operand];
        if (is_anchored_[operand]) {
          anchored = true;
          anchor = std::min(anchor, anchor_[operand]);
        }
      }
      for (std::size_t k = 0; k < operands_of(i); ++k) {
        if (is_anchored_[step.operands[k]]) {
          shape.distances[k] = anchor_[step.operands[k]] - anchor;
        }
      }
      if (operation == OpCode::integer_power) {
        shape.detail = step.operands[1];
      }
      const std::uint32_t results = operation == OpCode::sincos ? 2 : 1;
      for (std::uint32_t k = 0; k < results; ++k) {
        if (results == 2) {
          shape.detail = k;
        }
        const auto [entry, is_new] = known.try_emplace(shape, shapes_);
        shapes_ += is_new ? 1 : 0;
        const ValueNumber v = step.first_result + k;
        shape_[v] = entry->second;
        anchor_[v] = anchored ? anchor : 0;
        is_anchored_[v] = anchored;
      }
    }
  }

  /// Long enough ones of consecutive places, whose operands are constants, inputs or of such runs themselves.
  void find_runs() {
    std::vector<std::uint32_t> begin(shapes_ + 1, 0);
    for (std::size_t v = fixed_; v < count_; ++v) {
      ++begin[shape_[v] + 1];
    }
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    std::vector<ValueNumber> members(count_ - fixed_);
    std::vector<std::uint32_t> next(begin.begin(), begin.end() - 1);
    for (std::size_t v = fixed_; v < count_; ++v) {
      members[next[shape_[v]]++] = static_cast<ValueNumber>(v);
    }
    run_of_.assign(count_, not_there);
    const auto before = [&](ValueNumber a, ValueNumber b) { return anchor_[a] < anchor_[b]; };
    for (std::uint32_t s = 0; s < shapes_; ++s) {
      if (begin[s + 1] - begin[s] < lanes_ || !is_anchored_[members[begin[s]]]) {
        continue;
      }
      const auto first = members.begin() + begin[s], last = members.begin() + begin[s + 1];
      if (!std::is_sorted(first, last, before)) {
        std::sort(first, last, before);
      }
      for (auto from = first; from != last;) {
        auto to = from + 1;
        while (to != last && anchor_[*to] == anchor_[*(to - 1)] + 1) {
          ++to;
        }
        add_run({from, to});
        from = to;
      }
    }
  }

  void add_run(std::vector<ValueNumber> values) {
    if (values.size() < lanes_ || !operands_follow(values)) {
      return;
    }
    Run run;
    run.values = std::move(values);
    run.first_anchor = anchor_[run.values.front()];
    run.in_lanes = is_arithmetic(code_.instructions()[maker(run.values.front())].code);
    for (const ValueNumber v : run.values) {
      run_of_[v] = static_cast<std::uint32_t>(runs_.size());
    }
    runs_.push_back(std::move(run));
  }

  /// Shapes are numbered after those of their operands, whose runs are known here.
  [[nodiscard]] bool operands_follow(const std::vector<ValueNumber>& values) const {
    const std::size_t first = maker(values.front());
    for (std::size_t k = 0; k < operands_of(first); ++k) {
      const ValueNumber operand = assigned_.steps[first].operands[k];
      const bool constant = is_constant(operand), result = operand >= fixed_;
      if (result && run_of_[operand] == not_there) {
        return false;
      }
      for (std::size_t m = 1; m < values.size(); ++m) {
        const ValueNumber other = assigned_.steps[maker(values[m])].operands[k];
        const bool follows = constant ? other == operand
                             : result ? run_of_[other] == run_of_[operand] &&
                                            anchor_[other] == anchor_[operand] + static_cast<std::int32_t>(m)
                                      : other == operand + m;
        if (!follows) {
          return false;
        }
      }
    }
    return true;
  }

  // ---- what is kept and what is made anew, in which loops

  [[nodiscard]] bool made_in_lanes(ValueNumber v) const {
    return v >= fixed_ && run_of_[v] != not_there && runs_[run_of_[v]].in_lanes;
  }

  /// How often runs are read.
  void find_needs() {
    for (std::size_t i = 0; i < code_.instructions().size(); ++i) {
      if (made_in_lanes(assigned_.steps[i].first_result)) {
        continue;
      }
      for (std::size_t k = 0; k < operands_of(i); ++k) {
        if (const ValueNumber v = assigned_.steps[i].operands[k]; made_in_lanes(v)) {
          runs_[run_of_[v]].single_reads += 1.0;
        }
      }
    }
    // A loop has what its runs read of each other in registers; what is made anew elsewhere makes what it reads anew.
    // Runs come after those of their operands.
    for (std::size_t r = runs_.size(); r-- > 0;) {
      const Run& run = runs_[r];
      if (run.in_lanes) {
        for (const ValueNumber v : run_operands(run)) {
          Run& other = runs_[run_of_[v]];
          other.reads += is_beside(v, run)
                             ? run.reads
                             : static_cast<double>(run.values.size()) / static_cast<double>(other.values.size());
        }
      }
    }
    for (const ValueNumber v : assigned_.outputs) {
      if (made_in_lanes(v)) {
        runs_[run_of_[v]].is_output = true;
      }
    }
  }

  /// Runs come after those of their operands.
  void place_runs() {
    for (Run& run : runs_) {
      run.work = work_of(code_.instructions()[maker(run.values.front())].code);
      for (const ValueNumber v : run_operands(run)) {
        const Run& other = runs_[run_of_[v]];
        if (!other.in_lanes) {
          run.level = std::max(run.level, other.level + 1);
          run.level_elsewhere = std::max(run.level_elsewhere, other.level + 1);
          continue;
        }
        const bool beside = is_beside(v, run);
        const std::uint32_t elsewhere = !other.kept ? other.level_elsewhere : other.level + (run.in_lanes ? 1 : 0);
        run.level_elsewhere = std::max(run.level_elsewhere, elsewhere);
        run.level = std::max(run.level, other.kept && beside ? other.level : elsewhere);
        run.work += other.kept ? 0.0 : other.work;
      }
      last_phase_ = std::max(last_phase_, run.level);
      // In the loop that writes it a run is made in any case.
      const double again = run.reads - (run.is_output ? 0.0 : 1.0);
      run.kept = run.in_lanes &&
                 ((run.work > most_in_one_loop && run.reads > 0.0) || again * run.work > most_again ||
                  run.single_reads * run.work > std::max(most_again, static_cast<double>(run.values.size()) / 8.0));
    }
  }

  /// One for all that are kept or written of as many members, at a time when all they read is there.
  void find_loops() {
    for (std::uint32_t r = 0; r < runs_.size(); ++r) {
      const Run& run = runs_[r];
      if (!run.in_lanes || !(run.kept || run.is_output)) {
        continue;
      }
      const auto same = std::ranges::find_if(loops_, [&](const std::vector<std::uint32_t>& loop) {
        const Run& other = runs_[loop.front()];
        return other.level == run.level && other.values.size() == run.values.size();
      });
      if (same != loops_.end()) {
        same->push_back(r);
      } else {
        loops_.push_back({r});
      }
    }
    bodies_.resize(loops_.size());
    for (std::size_t l = 0; l < loops_.size(); ++l) {
      std::vector<ValueNumber> roots;
      for (const std::uint32_t r : loops_[l]) {
        roots.push_back(runs_[r].values.front());
      }
      std::unordered_set<ValueNumber> seen;
      for (const ValueNumber root : roots) {
        add_to_body(root, roots, seen, bodies_[l]);
      }
    }
  }

  void add_to_body(ValueNumber v, const std::vector<ValueNumber>& roots, std::unordered_set<ValueNumber>& seen,
                   Body& body) {
    if (v < fixed_ || !seen.insert(v).second) {
      return;
    }
    const Run& run = runs_[run_of_[v]];
    if ((!run.in_lanes || run.kept) && std::ranges::find(roots, v) == roots.end()) {
      body.read.push_back(run_of_[v]);
      return;
    }
    const std::size_t i = maker(v);
    for (std::size_t k = 0; k < operands_of(i); ++k) {
      add_to_body(assigned_.steps[i].operands[k], roots, seen, body);
    }
    body.instructions.push_back(static_cast<std::uint32_t>(i));
  }

  // ---- what is left, when

  void find_single() {
    phase_.assign(code_.instructions().size(), last_phase_);
    // As late as those who wait for it allow.
    const auto by = [&](ValueNumber v, std::uint32_t phase) {
      if (v >= fixed_ && !made_in_lanes(v)) {
        phase_[maker(v)] = std::min(phase_[maker(v)], phase);
      }
    };
    for (std::size_t l = 0; l < loops_.size(); ++l) {
      for (const std::uint32_t r : bodies_[l].read) {
        for (const ValueNumber v : runs_[r].values) {
          by(v, runs_[loops_[l].front()].level - 1);
        }
      }
    }
    single_.resize(last_phase_ + 1);
    for (std::size_t i = phase_.size(); i-- > 0;) {
      if (!made_in_lanes(assigned_.steps[i].first_result)) {
        for (std::size_t k = 0; k < operands_of(i); ++k) {
          by(assigned_.steps[i].operands[k], phase_[i]);
        }
        single_[phase_[i]].push_back(static_cast<std::uint32_t>(i));
      }
    }
    // With the members of runs that they need and nobody keeps.
    for (std::vector<std::uint32_t>& single : single_) {
      std::unordered_set<std::uint32_t> seen;
      for (std::size_t next = 0; next < single.size(); ++next) {
        const std::size_t i = single[next];
        for (std::size_t k = 0; k < operands_of(i); ++k) {
          const ValueNumber v = assigned_.steps[i].operands[k];
          if (made_in_lanes(v) && !runs_[run_of_[v]].kept && seen.insert(v).second) {
            single.push_back(static_cast<std::uint32_t>(maker(v)));
          }
        }
      }
      std::ranges::sort(single);
    }
  }

  // ---- outputs

  void find_outputs() {
    const auto outputs = static_cast<std::uint32_t>(assigned_.outputs.size());
    std::vector<std::uint32_t> first(count_, not_there), next(outputs, not_there);
    for (std::uint32_t j = outputs; j-- > 0;) {
      next[j] = std::exchange(first[assigned_.outputs[j]], j);
    }
    std::vector<bool> copied(outputs, false);
    for (std::uint32_t j = 0; j < outputs;) {
      std::uint32_t end = j + 1;
      while (end < outputs && assigned_.outputs[end] == assigned_.outputs[end - 1] + 1) {
        ++end;
      }
      if (assigned_.outputs[j] < code_.input_count()) {
        const auto left = static_cast<std::uint32_t>(code_.input_count()) - assigned_.outputs[j];
        const std::uint32_t count = std::min(end - j, left);
        if (count >= shortest_copy) {
          result_.copies.push_back({assigned_.outputs[j], j, count});
        } else {
          for (std::uint32_t k = j; k < j + count; ++k) {
            result_.late.push_back(assigned_.outputs[k]);
          }
        }
        j += count;
      } else {
        j = end;
      }
    }
    // An input that is copied and late, too, is written twice, with the same number.
    for (std::uint32_t r = 0; r < runs_.size(); ++r) {
      if (runs_[r].in_lanes && runs_[r].is_output) {
        stores_of(r, first, next);
      }
    }
    std::ranges::sort(result_.late);
    const auto again = std::ranges::unique(result_.late);
    result_.late.erase(again.begin(), again.end());
  }

  void stores_of(std::uint32_t r, const std::vector<std::uint32_t>& first, const std::vector<std::uint32_t>& next) {
    const auto list = [&](ValueNumber v) {
      std::vector<std::uint32_t> all;
      for (std::uint32_t j = first[v]; j != not_there; j = next[j]) {
        all.push_back(j);
      }
      return all;
    };
    const std::vector<ValueNumber>& values = runs_[r].values;
    const std::vector<std::uint32_t> here = list(values[0]), there = list(values[1]);
    bool regular = here.size() == there.size();
    for (std::size_t k = 0; regular && k < here.size(); ++k) {
      regular = there[k] > here[k];
    }
    for (std::uint32_t m = 0; regular && m < values.size(); ++m) {
      std::uint32_t j = first[values[m]];
      for (std::size_t k = 0; regular && k < here.size(); ++k) {
        regular = j != not_there && j == here[k] + m * (there[k] - here[k]);
        j = regular ? next[j] : not_there;
      }
      regular = regular && j == not_there;
    }
    if (regular) {
      for (std::size_t k = 0; k < here.size(); ++k) {
        stores_.push_back({r, {values.front(), here[k], there[k] - here[k]}});
      }
      return;
    }
    runs_[r].kept = true;
    runs_[r].last_phase = last_phase_;
    for (const ValueNumber v : values) {
      if (first[v] != not_there) {
        result_.late.push_back(v);
      }
    }
  }

  // ---- what is kept where

  void find_kept() {
    const auto keep = [&](std::uint32_t r, std::uint32_t phase) {
      runs_[r].kept = true;
      runs_[r].last_phase = std::max(runs_[r].last_phase, phase);
    };
    for (std::size_t l = 0; l < loops_.size(); ++l) {
      for (const std::uint32_t r : bodies_[l].read) {
        keep(r, runs_[loops_[l].front()].level);
      }
    }
    kept_alone_.assign(count_, false);
    for (std::uint32_t phase = 0; phase <= last_phase_; ++phase) {
      for (const std::uint32_t i : single_[phase]) {
        for (std::size_t k = 0; k < operands_of(i); ++k) {
          const ValueNumber v = assigned_.steps[i].operands[k];
          if (made_in_lanes(v) && runs_[run_of_[v]].kept) {
            keep(run_of_[v], phase);
          } else if (v >= fixed_ && !made_in_lanes(v) && phase_[maker(v)] != phase) {
            kept_alone_[v] = true;
          }
        }
      }
    }
    // In a run that is kept its members have their places, from when the first is made.
    for (auto v = static_cast<ValueNumber>(fixed_); v < count_; ++v) {
      if (run_of_[v] != not_there && runs_[run_of_[v]].kept && !made_in_lanes(v)) {
        keep(run_of_[v], kept_alone_[v] ? last_phase_ : phase_[maker(v)]);
        kept_alone_[v] = false;
      }
    }
  }

  /// Runs that are needed no more leave their places to others.
  void place_kept() {
    result_.place.assign(count_, not_there);
    struct Room {
      std::size_t first, size;
    };
    std::vector<Room> free;
    std::vector<std::vector<std::uint32_t>> begin(last_phase_ + 1);
    for (std::uint32_t r = 0; r < runs_.size(); ++r) {
      if (runs_[r].kept) {
        begin[runs_[r].level].push_back(r);
      }
    }
    std::vector<std::vector<Room>> end(last_phase_ + 1);
    for (std::uint32_t phase = 0; phase <= last_phase_; ++phase) {
      for (const std::uint32_t r : begin[phase]) {
        const Run& run = runs_[r];
        const std::size_t size = (run.values.size() + line - 1) / line * line;
        auto room = std::ranges::find_if(free, [&](const Room& one) { return one.size >= size; });
        std::size_t first = result_.places;
        if (room != free.end()) {
          first = room->first;
          room->first += size;
          room->size -= size;
        } else {
          result_.places += size;
        }
        for (std::size_t m = 0; m < run.values.size(); ++m) {
          result_.place[run.values[m]] = static_cast<std::uint32_t>(first + m);
        }
        end[std::max(run.last_phase, phase)].push_back({first, size});
      }
      free.insert(free.end(), end[phase].begin(), end[phase].end());
    }
    for (std::size_t v = fixed_; v < count_; ++v) {
      if (kept_alone_[v]) {
        result_.place[v] = static_cast<std::uint32_t>(result_.places++);
      }
    }
  }

  void write_phases() {
    result_.phases.resize(last_phase_ + 1);
    for (std::size_t l = 0; l < loops_.size(); ++l) {
      const Run& first = runs_[loops_[l].front()];
      RolledCode::Loop loop;
      loop.body = std::move(bodies_[l].instructions);
      loop.length = static_cast<std::uint32_t>(first.values.size());
      for (const auto& [run, store] : stores_) {
        if (std::ranges::find(loops_[l], run) != loops_[l].end()) {
          loop.stores.push_back(store);
        }
      }
      result_.phases[first.level].loops.push_back(std::move(loop));
    }
    for (std::uint32_t phase = 0; phase <= last_phase_; ++phase) {
      result_.phases[phase].single = std::move(single_[phase]);
    }
  }

  // ---- small questions

  /// Whether an operand of the run's first member is the first of as many that one loop makes with it.
  [[nodiscard]] bool is_beside(ValueNumber operand, const Run& run) const {
    const Run& other = runs_[run_of_[operand]];
    return operand == other.values.front() && other.values.size() == run.values.size();
  }
  [[nodiscard]] std::size_t maker(ValueNumber v) const { return assigned_.maker[v - fixed_]; }
  [[nodiscard]] std::size_t operands_of(std::size_t i) const {
    return static_cast<std::size_t>(operand_count(code_.instructions()[i].code));
  }
  [[nodiscard]] bool is_constant(ValueNumber v) const {
    return v < fixed_ && (v >= code_.input_count() || result_.common[v]);
  }
  /// What a run's first member reads of runs, each once.
  [[nodiscard]] std::vector<ValueNumber> run_operands(const Run& run) const {
    std::vector<ValueNumber> all;
    const std::size_t i = maker(run.values.front());
    for (std::size_t k = 0; k < operands_of(i); ++k) {
      const ValueNumber v = assigned_.steps[i].operands[k];
      if (v >= fixed_ && std::ranges::find(all, v) == all.end()) {
        all.push_back(v);
      }
    }
    return all;
  }
  /// In sums, of several at a time.
  static double work_of(OpCode code) {
    return code == OpCode::divide || code == OpCode::sqrt || code == OpCode::integer_power ? 8.0 : 1.0;
  }

  /// So much is made in one loop: more would not find room in registers.
  static constexpr double most_in_one_loop = 40.0;
  /// And so much more than once, rather than be kept and read.
  static constexpr double most_again = 8.0;
  static constexpr std::size_t line = 8;  ///< doubles of a line of the cache
  static constexpr std::uint32_t shortest_copy = 32;
  /// An input that is read so many times as often as inputs are on average is no member of a run.
  static constexpr double many_times = 4.0;

  const Bytecode& code_;
  const SingleAssignment& assigned_;
  const std::size_t lanes_, fixed_, count_;
  std::vector<std::uint32_t> shape_;  ///< of each value
  std::vector<std::int32_t> anchor_;  ///< the first input that it depends on
  std::vector<bool> is_anchored_;
  std::uint32_t shapes_ = 0;
  std::vector<std::uint32_t> run_of_;
  std::vector<Run> runs_;
  std::vector<std::vector<std::uint32_t>> loops_;  ///< the runs of each that are kept or written
  std::vector<Body> bodies_;
  std::vector<std::uint32_t> phase_;                ///< of instructions in no loop
  std::vector<std::vector<std::uint32_t>> single_;  ///< by phase
  std::uint32_t last_phase_ = 0;
  std::vector<bool> kept_alone_;
  std::vector<std::pair<std::uint32_t, RolledCode::Store>> stores_;  ///< by run
  RolledCode result_;
};

}  // namespace

std::optional<RolledCode> roll(const Bytecode& code, const SingleAssignment& assigned, int lanes) {
  return Rolling(code, assigned, lanes).roll();
}

}  // namespace rubato::formula
