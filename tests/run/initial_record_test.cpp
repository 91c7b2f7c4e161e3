// [initial] from: a state of another run as the start.

#include <catch2/catch.hpp>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "problem/problem_texts.hpp"
#include "run/records.hpp"

using namespace rubato;
using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

/// The text with another [initial].
std::string beginning(const std::string& text, const std::string& initial) {
  const std::size_t begin = text.find("[initial]\n") + std::string("[initial]\n").size();
  return text.substr(0, begin) + initial + "\n" + text.substr(text.find("\n[", begin) + 1);
}

const std::string lattice =
    replaced(replaced(replaced(replaced(breather, "until = 20", "until = 1"), "cells = 401", "cells = 101"),
                      "[symmetries]\nturn = [[\"u\", \"v\", 1], [\"v\", \"u\", -1]]\n", ""),
             "levels = \"variable\"", "levels = \"fixed\"");

Outcome run_text(const std::string& text, const std::string& file, const std::vector<std::string>& settings = {}) {
  return run(parse_problem(text, "t.toml", settings), {.output = file});
}

std::string refusal(const std::string& text) {
  const Folder folder;
  try {
    static_cast<void>(run_text(text, folder / "never.h5"));
  } catch (const ProblemError& error) {
    CHECK_FALSE(std::filesystem::exists(folder / "never.h5"));
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("an orbit starts where another one was") {
  const Folder folder;
  const std::string old = folder / "old.h5";
  REQUIRE(run_text(pendulum, old).status == ExitStatus::done);
  const record::Reader reader(old);
  const std::string from = fmt::format("from = \"{}\"\n", old);
  // Nearest to 5: with steps of 0.1 and more there is one within 0.11.
  const Problem there = parse_problem(beginning(pendulum, from + "at = 5"), "t.toml");
  const PhasePoint& point = there.hamiltonian()->initial;
  CHECK(point.t == Approx(5.0).margin(0.11));
  const std::vector<double> t = reader.read("/states/t");
  const auto row = static_cast<std::size_t>(std::ranges::find(t, point.t) - t.begin());
  REQUIRE(row < t.size());
  CHECK(point.q.front() == reader.read("/states/q", row, 1).front());
  CHECK(point.p.front() == reader.read("/states/p", row, 1).front());
  CHECK(parse_problem(beginning(pendulum, from), "t.toml", std::vector<std::string>{"scheme.until=50"}).start() ==
        t.back());
  // What is said goes first; the problem of the record does not name the other record.
  const Problem mixed = parse_problem(beginning(pendulum, from + "at = 5\np = 0.25\nt = 1"), "t.toml");
  CHECK(mixed.hamiltonian()->initial.p.front() == 0.25);
  CHECK(mixed.hamiltonian()->initial.q.front() == point.q.front());
  CHECK(mixed.start() == 1.0);
  CHECK_THAT(mixed.text, !Contains("old.h5"));
}

TEST_CASE("a lattice starts where another one was, on its grid bit by bit, and its record needs no other") {
  const Folder folder;
  const std::string old = folder / "old.h5", next = folder / "next.h5", straight = folder / "straight.h5";
  REQUIRE(run_text(lattice, old).status == ExitStatus::done);
  const std::string text = beginning(lattice, fmt::format("from = \"{}\"", old));
  const Outcome ran = run_text(text, next, {"scheme.until=2"});
  REQUIRE(ran.status == ExitStatus::done);
  const record::Reader before(old), after(next);
  const std::size_t last = before.rows("/states/t") - 1;
  CHECK(after.read("/states/t", 0, 1) == before.read("/states/t", last, 1));
  for (const char* const field : {"/states/u", "/states/v"}) {
    CHECK(after.read(field, 0, 1) == before.read(field, last, 1));
  }
  // With equal steps that is the run that did not stop, up to the rounding that a run carries beside its states.
  REQUIRE(run_text(lattice, straight, {"scheme.until=2"}).status == ExitStatus::done);
  const record::Reader whole(straight);
  const std::vector<double> a = whole.read("/states/u", whole.rows("/states/t") - 1, 1),
                            b = after.read("/states/u", after.rows("/states/t") - 1, 1);
  double off = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    off = std::max(off, std::abs(a[i] - b[i]));
  }
  CHECK(off < 1e-12);
  CHECK(off > 0.0);  // the twin: they are not one record
  std::filesystem::remove(old);
  const Outcome checked = check(next, {.replay = true});
  CHECK(checked.status == ExitStatus::done);
  CHECK(differences(ran, checked) == Names{});
  CHECK(resume(next, 2.5, {.threads = 1}).status == ExitStatus::done);
  CHECK(check(next, {.replay = true}).status == ExitStatus::done);
}

TEST_CASE("between grids the start is interpolated by waves") {
  const Folder folder;
  const std::string old = folder / "old.h5";
  REQUIRE(run_text(lattice, old, {"scheme.until=0.5"}).status == ExitStatus::done);
  const std::string text = beginning(lattice, fmt::format("from = \"{}\"\nat = 0", old));
  REQUIRE(run_text(text, folder / "fine.h5", {"scheme.until=0.1", "grid.x.cells=303"}).status == ExitStatus::done);
  const record::Reader coarse(old), fine(folder / "fine.h5");
  const std::vector<double> v = coarse.read("/states/v", 0, 1), w = fine.read("/states/v", 0, 1);
  for (std::size_t i = 0; i < v.size(); ++i) {
    CHECK(w[3 * i] == Approx(v[i]).margin(1e-13));
  }
  REQUIRE(w.size() == 303);
}

TEST_CASE("a start from a record that cannot be is refused with the reason, and nothing is written") {
  const Folder folder;
  const std::string old = folder / "old.h5", orbit = folder / "orbit.h5";
  REQUIRE(run_text(lattice, old, {"scheme.until=0.2"}).status == ExitStatus::done);
  REQUIRE(run_text(pendulum, orbit).status == ExitStatus::done);
  const std::string from = fmt::format("from = \"{}\"\n", old), from_orbit = fmt::format("from = \"{}\"\n", orbit);
  // A file that cannot be read, for whatever reason, is one fault, with status 5; what is wrong in it, another.
  const auto unreadable = [](const std::string& text) -> std::string {
    try {
      static_cast<void>(parse_problem(text, "t.toml"));
    } catch (const FileError& error) {
      return error.what();
    }
    return "";
  };
  std::ofstream(folder / "damaged.h5") << "no record";
  CHECK_THAT(unreadable(beginning(pendulum, "from = \"missing.h5\"")), Contains("t.toml:9:9: from: missing.h5"));
  CHECK_THAT(unreadable(beginning(lattice, "from = \"missing.csv\"")), Contains("missing.csv cannot be read"));
  CHECK_THAT(unreadable(beginning(pendulum, fmt::format("from = \"{}\"", folder / "damaged.h5"))),
             Contains("t.toml:9:9: from: "));
  CHECK_THROWS_AS(parse_problem(beginning(pendulum, from), "t.toml"), ProblemError);
  CHECK_THAT(refusal(beginning(pendulum, from)), Contains("is not the record of an orbit"));
  CHECK_THAT(refusal(beginning(lattice, from_orbit)), Contains("is not the record of a lattice"));
  CHECK_THAT(refusal(beginning(pendulum, from_orbit + "at = 11.5")), Contains("at = 11.5 is outside of the record"));
  CHECK_THAT(refusal(beginning(pendulum, from_orbit + "at = true")), Contains("at: expected a number"));
  CHECK_THAT(refusal(beginning(pendulum, "from = 3")), Contains("from: expected a string"));
  CHECK_THAT(refusal(beginning(lattice, "u = 0\nv = 0\nat = 1")), Contains("give its name, from ="));
  CHECK_THAT(refusal(beginning(lattice, from + "take = [\"b\"]\nat = 0")), Contains("there is no field b here"));
  CHECK_THAT(refusal(replaced(beginning(lattice, from), "to = 20", "to = 21")),
             Contains("only the number of cells may differ"));
  CHECK_THAT(refusal(replaced(beginning(pendulum, from_orbit), "\"q\"]", "\"q\", \"r\"]")),
             Contains("every coordinate needs"));
  CHECK_THROWS_WITH(run(parse_problem(beginning(lattice, from), "t.toml", std::vector<std::string>{"scheme.until=2"}),
                        {.output = old, .overwrite = true}),
                    Contains("would replace the record that it begins from"));
}

namespace {

void write_file(const std::string& file, const std::string& text) {
  std::ofstream(file) << text;
}

/// u and v of the breather's start at the nodes of a grid of `cells`, rows backwards, as a table with places.
std::string table_of(int cells) {
  std::string text = "# of another program\n\"x\", u ,v\r\n";
  for (int i = cells - 1; i >= 0; --i) {
    const double x = -20.0 + 40.0 * i / cells;
    text += fmt::format("{:.8g},{:.17g},+{:.17g}\r\n", x, 0.0, 2.0 * std::sqrt(3.0) / std::cosh(std::sqrt(0.75) * x));
  }
  return text;
}

}  // namespace

TEST_CASE("a start may be read from a table") {
  const Folder folder;
  const std::string table = folder / "start.csv";
  const std::string from = fmt::format("from = \"{}\"\n", table);

  write_file(table, "q,p\n0.25,1.5\n");
  const Problem orbit = parse_problem(beginning(pendulum, from), "t.toml");
  CHECK(orbit.hamiltonian()->initial.q.front() == 0.25);
  CHECK(orbit.hamiltonian()->initial.p.front() == 1.5);

  REQUIRE(run_text(lattice, folder / "formulas.h5").status == ExitStatus::done);
  const record::Reader formulas(folder / "formulas.h5");
  const std::size_t last = formulas.rows("/states/t") - 1;
  const std::vector<double> expected = formulas.read("/states/u", last, 1);
  // 101 cells are those of the problem; 128 are interpolated. e^-17 of the breather is left at the ends, and places are
  // written with 8 digits.
  for (const int cells : {101, 128}) {
    write_file(table, table_of(cells));
    const std::string file = folder / fmt::format("table{}.h5", cells);
    REQUIRE(run_text(beginning(lattice, from), file).status == ExitStatus::done);
    std::filesystem::remove(table);
    const std::vector<double> found = record::Reader(file).read("/states/u", last, 1);
    double largest = 0.0;
    for (std::size_t i = 0; i < found.size(); ++i) {
      largest = std::max(largest, std::abs(found[i] - expected[i]));
    }
    CHECK(largest < 1e-6);
    CHECK(check(file).status == ExitStatus::done);  // the record does not need the table
  }
  std::string values = "u,v\n";
  for (int i = 0; i < 101; ++i) {
    values += fmt::format("0,{}\n", i);
  }
  write_file(table, values);
  REQUIRE(run_text(beginning(lattice, from), folder / "plain.h5").complete);
  CHECK(record::Reader(folder / "plain.h5").read("/states/v", 0, 1)[7] == 7.0);
}

TEST_CASE("a table that does not do is refused with the place in it") {
  const Folder folder;
  const std::string table = folder / "start.csv";
  const std::string from = fmt::format("from = \"{}\"\n", table);
  const auto refused = [&](const std::string& text, bool is_lattice = true) {
    write_file(table, text);
    return refusal(beginning(is_lattice ? lattice : pendulum, from));
  };
  CHECK_THAT(refused("u,v\n1,two\n"), Contains("start.csv:2:3: \"two\" is not a finite number"));
  CHECK_THAT(refused("u,v\n1,2,3\n"), Contains("start.csv:2:1: 3 values, and the first line names 2 columns"));
  CHECK_THAT(refused("u,u\n1,2\n"), Contains("start.csv:1:3: the column u is there twice"));
  CHECK_THAT(refused("u,2nd\n1,2\n"), Contains("\"2nd\" is no name"));
  CHECK_THAT(refused("u,v\n"), Contains("no row of numbers"));
  CHECK_THAT(refused("u,v\n1,inf\n"), Contains("not a finite number"));
  CHECK_THAT(refused("u,v\n1,2\n"), Contains("1 rows, and the grid 101 nodes"));
  CHECK_THAT(refused("u,v,height\n1,2,3\n"), Contains("there is no field height here"));
  CHECK_THAT(refused("x,u,v\n0,1,2\n0,1,2\n0,1,2\n"), Contains("1 places along x"));
  CHECK_THAT(refused("x,u,v\n-20,1,2\n0,1,2\n10,1,2\n"), Contains("start.csv:3: x = 0 is not one of the 3 nodes"));
  CHECK_THAT(refused("x,u,v\n-20,1,2\n-20,1,2\n0,1,2\n10,1,2\n"),
             Contains("has 4 rows, and its places make a grid of 3"));
  CHECK_THAT(refused("q,p\n1,2\n3,4\n", false), Contains("has 2 rows; the start of an orbit is one"));
  CHECK_THAT(refused("q,pp\n1,2\n", false), Contains("pp"));
}

TEST_CASE("an equation starts where another run was, at the time of the level whatever is taken of it") {
  const Folder folder;
  const std::string text =
      "[field]\nequation = \"u_tt = u_xx - sin(u)\"\n[grid]\nx = { from = -20, to = 20, cells = 51 }\n"
      "[initial]\nu = \"sech(x)\"\nu_t = \"0.3*sech(x)\"\n[scheme]\nlagrangian = \"fourier\"\n"
      "levels = \"fixed\"\nstep = 0.1\nuntil = 1\n";
  const std::string whole = folder / "whole.h5", first = folder / "first.h5", then = folder / "then.h5";
  REQUIRE(run_text(text, whole).status == ExitStatus::done);
  REQUIRE(run_text(text, first, {"scheme.until=0.5"}).status == ExitStatus::done);
  const auto last = [](const std::string& file) {
    const record::Reader reader(file);
    return reader.read("/states/u", reader.rows("/states/u") - 1, 1);
  };
  const std::string from = fmt::format("from = \"{}\"\n", first);
  for (const char* const rest : {"", "take = [\"u\", \"u_t\"]\n", "at = 0.5\ntake = [\"u_t\", \"u\"]\n"}) {
    INFO(rest);
    const std::string file = folder / fmt::format("{}.h5", std::string(rest).size());
    REQUIRE(run_text(beginning(text, from + rest), file).status == ExitStatus::done);
    CHECK(record::Reader(file).read("/states/t").front() == Approx(0.5).margin(1e-12));
    const std::vector<double> u = last(file), expected = last(whole);
    double worst = 0.0;
    for (std::size_t i = 0; i < u.size(); ++i) {
      worst = std::max(worst, std::abs(u[i] - expected[i]));
    }
    CHECK(worst < 1e-13);  // some roundings in each of five steps
    CHECK(check(file).status == ExitStatus::done);
  }
  // Another state, at another time.
  REQUIRE(run_text(beginning(text, from + "at = 0.2\ntake = [\"u\", \"u_t\"]"), then).status == ExitStatus::done);
  CHECK(record::Reader(then).read("/states/t").front() == Approx(0.2).margin(1e-12));
  CHECK(parse_problem(beginning(text, from + "take = [\"u\"]\nu_t = 0\nt = 7"), "t.toml",
                      std::vector<std::string>{"scheme.until=8"})
            .start() == 7.0);
  CHECK_THAT(refusal(beginning(text, from + "take = [\"v\"]")), Contains("there is no field v here; name those that"));
  const std::string orbit = folder / "orbit.h5";
  REQUIRE(run_text(pendulum, orbit).status == ExitStatus::done);
  CHECK_THAT(refusal(beginning(pendulum, fmt::format("from = \"{}\"\ntake = [\"q\"]", orbit))),
             Contains("take is for lattices"));
}
