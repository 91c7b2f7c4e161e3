#pragma once

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include <rubato/record/writer.hpp>

namespace sample {

namespace record = rubato::record;

/// A folder of its own for one test, removed afterwards.
class Folder {
public:
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "rubato-record-XXXXXX").string();
    path_ = ::mkdtemp(name.data());
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  ~Folder() { std::filesystem::remove_all(path_); }

  [[nodiscard]] std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

private:
  std::filesystem::path path_;
};

// Numbers of the datasets in the layout below.
enum Id : std::size_t { level_t, gamma, step, h, energy, off_law, state_t, q, previous_t, previous_q, u, flux };

/// A layout with everything that the interface asks of records: an orbit and a 2D lattice at once.
inline record::Layout layout(std::size_t cells = 5) {
  std::vector<double> x(cells);
  for (std::size_t i = 0; i < cells; ++i)
    x[i] = -20.0 + 0.1 * static_cast<double>(i);
  return {.title = "A pendulum — Γ, θ̇",
          .problem = "title = \"A pendulum — Γ, θ̇\"\n[hamiltonian]\nH = \"p^2/2 - cos(q)\"\n",
          .version = "0.1.0",
          .compiler = "g++",
          .threads = 2,
          .compression = 4,
          .scales = {{"/grid/y", std::vector<double>{0.0, 0.5, 1.0}},
                     {"/grid/x", x, "node coordinates"},
                     {"/states/coordinate", std::vector<std::string>{"θ", "q2"}, "names of the coordinates"}},
          .datasets = {{"/levels/t", "/levels/t", {}, record::Type::f64, "time of every level"},
                       {"/levels/gamma", "/levels/t", {}, record::Type::f64, "Γ", true},
                       {"/levels/step", "/levels/step", {}, record::Type::i64, "number of the step"},
                       {"/levels/h", "/levels/step"},
                       {"/levels/energy", "/levels/step"},
                       {"/levels/off_law", "/levels/step", {}, record::Type::u8},
                       {"/states/t", "/states/t"},
                       {"/states/q", "/states/t", {"/states/coordinate"}},
                       {"/states/previous/t", "/states/previous/t"},
                       {"/states/previous/q", "/states/previous/t", {"/states/coordinate"}},
                       {"/states/u", "/states/t", {"/grid/y", "/grid/x"}},
                       {"/laws/energy", "/states/t", {"/grid/y", "/grid/x"}}}};
}

/// A run whose whole state is one number: the level k; every third level is stored.
struct Run {
  std::int64_t k = 0;
  std::size_t cells = 5;

  [[nodiscard]] record::Checkpoint checkpoint() const {
    return {{"level", std::vector<std::int64_t>{k}},
            {"state", std::vector<double>{std::sin(static_cast<double>(k)), 1e-300}},
            {"history", std::vector<double>(static_cast<std::size_t>(k % 7), 0.25)},  // changes its size
            {"engine", std::string("a\0b", 3)}};
  }

  /// Appends level k (and the step that leads to it).
  void write(record::Writer& writer) const {
    const auto number = static_cast<double>(k);
    writer.append(level_t, 0.1 * number);
    writer.append(gamma, k == 0 ? NAN : std::cos(number));
    if (k > 0) {
      writer.append(step, k - 1);
      writer.append(h, 0.1 + 1e-3 * std::sin(number));
      writer.append(energy, -0.5 + 1e-16 * number);
      writer.append(off_law, k % 10 == 0);
    }
    if (k % 3 == 0) {
      writer.append(state_t, 0.1 * number);
      writer.append(q, std::vector{std::sin(number), std::cos(number)});
      writer.append(previous_t, 0.1 * (number - 1));
      writer.append(previous_q, std::vector{std::sin(number - 1), std::cos(number - 1)});
      std::vector<double> field(3 * cells);
      for (std::size_t i = 0; i < field.size(); ++i)
        field[i] = std::sin(number + 0.01 * static_cast<double>(i));
      writer.append(u, field);
      writer.append(flux, field);
    }
    writer.end_level();
  }
};

/// Runs from the start to level `last` without stopping.
inline void write_whole(const std::filesystem::path& file, std::int64_t last, record::CommitPolicy policy = {},
                        std::size_t cells = 5) {
  auto writer = record::Writer::create(file, layout(cells), false, policy);
  Run run{0, cells};
  run.write(writer);
  writer.commit(run.checkpoint());
  while (run.k < last) {
    ++run.k;
    run.write(writer);
    if (writer.commit_due())
      writer.commit(run.checkpoint());
  }
  writer.finish(run.checkpoint(), record::Writer::Completion::complete);
}

/// What differs between two records, dataset by dataset and bit by bit; empty if nothing does.
std::string difference(const std::filesystem::path& a, const std::filesystem::path& b);

}  // namespace sample
