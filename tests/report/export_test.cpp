#include <fstream>
#include <regex>
#include <sstream>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <hdf5.h>
#include <catch2/catch.hpp>

#include <rubato/record/reader.hpp>
#include <rubato/report/comparison.hpp>
#include <rubato/report/csv.hpp>
#include <rubato/report/xdmf.hpp>

#include "record/sample.hpp"
#include "records.hpp"

using namespace rubato;

namespace {

std::string text_of(const std::filesystem::path& file) {
  std::ifstream stream(file);
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

std::vector<std::vector<std::string>> rows_of(const std::string& text) {
  std::vector<std::vector<std::string>> rows;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    rows.emplace_back();
    std::istringstream cells(line);
    for (std::string cell; std::getline(cells, cell, ',');) {
      rows.back().push_back(cell);
    }
  }
  return rows;
}

}  // namespace

TEST_CASE("CSV reads back as the same numbers") {
  const sample::Folder folder;
  sample::write_orbit(folder / "orbit.h5", {.steps = 9000, .dimension = 2});
  const record::Reader reader(folder / "orbit.h5");
  CHECK(report::export_csv(reader, folder / "csv").size() == 3);
  const auto levels = rows_of(text_of(folder / "csv" / "levels.csv"));
  CHECK(levels[0] == std::vector<std::string>{"level", "t", "gamma", "node_energy", "momentum"});
  const std::vector<double> t = reader.read("/levels/t");
  REQUIRE(levels.size() == t.size() + 1);
  bool same = true, shorter_is_same = true;
  for (std::size_t k = 0; k < t.size(); ++k) {
    same = same && std::stod(levels[k + 1][1]) == t[k] && levels[k + 1][0] == std::to_string(k);
    std::ostringstream twelve_digits;
    twelve_digits.precision(12);
    twelve_digits << t[k];
    shorter_is_same = shorter_is_same && std::stod(twelve_digits.str()) == t[k];
  }
  CHECK(same);
  CHECK_FALSE(shorter_is_same);
  const auto states = rows_of(text_of(folder / "csv" / "states.csv"));
  CHECK(states[0] == std::vector<std::string>{"level", "t", "q1", "q2", "p1", "p2", "exact_q1"});
  CHECK(std::stod(states[5001][3]) == reader.read("/states/q")[2 * 5000 + 1]);
  CHECK(rows_of(text_of(folder / "csv" / "steps.csv")).size() == 9001);
}

TEST_CASE("CSV of an event has a row for each crossing") {
  const sample::Folder folder;
  sample::write_orbit(folder / "orbit.h5", {.steps = 10, .crossings = 3});
  const record::Reader reader(folder / "orbit.h5");
  CHECK(report::export_csv(reader, folder / "csv").size() == 4);
  const auto rows = rows_of(text_of(folder / "csv" / "events_section.csv"));
  REQUIRE(rows.size() == 31);
  CHECK(rows[0] == std::vector<std::string>{"t", "direction", "y", "v"});
  CHECK(std::stod(rows[30][3]) == reader.read("/events/section/quantities")[59]);
}

TEST_CASE("CSV of a plane names the coordinates of every column") {
  const sample::Folder folder;
  sample::write_lattice(folder / "plane.h5", {.levels = 4, .nx = 5, .ny = 3});
  const record::Reader reader(folder / "plane.h5");
  report::export_csv(reader, folder / "csv");
  const auto rows = rows_of(text_of(folder / "csv" / "field_u.csv"));
  REQUIRE(rows.size() == 2 + 4);
  CHECK(rows[0][0] == "y");
  CHECK(rows[1][0] == "x");
  const std::vector<double> x = reader.read("/grid/x"), y = reader.read("/grid/y"), u = reader.read("/states/u");
  for (std::size_t i = 0; i < 15; ++i) {
    CHECK(std::stod(rows[0][i + 1]) == y[i / 5]);
    CHECK(std::stod(rows[1][i + 1]) == x[i % 5]);
    CHECK(std::stod(rows[4][i + 1]) == u[2 * 15 + i]);
  }
  CHECK(rows_of(text_of(folder / "csv" / "residual_energy.csv"))[2][1] == "nan");
}

TEST_CASE("exports overwrite only when told to") {
  const sample::Folder folder;
  sample::write_lattice(folder / "line.h5", {});
  const record::Reader reader(folder / "line.h5");
  report::export_csv(reader, folder / "csv");
  CHECK_THROWS_AS(report::export_csv(reader, folder / "csv"), record::AlreadyExists);
  CHECK_NOTHROW(report::export_csv(reader, folder / "csv", true));
  // XDMF of the same record is brought up to date; that of another one, or whatever else there is, is left alone.
  report::export_xdmf(reader, folder / "line.xdmf");
  const std::string text = text_of(folder / "line.xdmf");
  CHECK_NOTHROW(report::export_xdmf(reader, folder / "line.xdmf"));
  sample::write_lattice(folder / "other.h5", {});
  CHECK_THROWS_AS(report::export_xdmf(record::Reader(folder / "other.h5"), folder / "line.xdmf"),
                  record::AlreadyExists);
  CHECK(text_of(folder / "line.xdmf") == text);
  std::ofstream(folder / "line.xdmf") << "mine";
  CHECK_THROWS_AS(report::export_xdmf(reader, folder / "line.xdmf"), record::AlreadyExists);
  CHECK_NOTHROW(report::export_xdmf(reader, folder / "line.xdmf", true));
}

TEST_CASE("XDMF refers to rows that the record has") {
  const sample::Folder folder;
  const auto [nx, ny, nz] = GENERATE(table<std::size_t, std::size_t, std::size_t>({{9, 1, 1}, {9, 7, 1}, {9, 7, 5}}));
  sample::write_lattice(folder / "l.h5", {.levels = 6, .nx = nx, .ny = ny, .nz = nz});
  const record::Reader reader(folder / "l.h5");
  std::filesystem::create_directory(folder / "seen");
  report::export_xdmf(reader, folder / "seen" / "l.xdmf");
  const std::string text = text_of(folder / "seen" / "l.xdmf");
  static const std::regex item(
      R"re(XML">(\d+)[^<]*</DataItem>\s*<DataItem Dimensions="([\d ]+)"[^>]*>([^:<]+):([^<]+)<)re");
  std::size_t items = 0;
  bool all_there = true, one_row_later_too = true;
  for (std::sregex_iterator match(text.begin(), text.end(), item), end; match != end; ++match, ++items) {
    const record::DatasetInfo info = reader.info((*match)[4]);
    const std::string shape = fmt::format("{}", fmt::join(info.shape, " "));
    const std::size_t level = std::stoul((*match)[1]);
    all_there = all_there && level < info.shape[0] && (*match)[2] == shape && (*match)[3] == "../l.h5";
    one_row_later_too = one_row_later_too && level + 1 < info.shape[0];
  }
  CHECK(items == 6 * 3);
  CHECK(all_there);
  CHECK_FALSE(one_row_later_too);
  CHECK(text.find(nz == 1 ? "2DCoRectMesh" : "3DCoRectMesh") != std::string::npos);

  sample::write_orbit(folder / "orbit.h5", {});
  CHECK_THROWS_AS(report::export_xdmf(record::Reader(folder / "orbit.h5"), folder / "o.xdmf"), std::invalid_argument);
}

TEST_CASE("two records side by side") {
  const sample::Folder folder;
  sample::write_orbit(folder / "a.h5",
                      {.problem = "[scheme]\nlevels = \"variable\"  # as # they follow\n\nstep = 0.1\n"});
  sample::write_orbit(folder / "b.h5",
                      {.steps = 300, .problem = "# fixed\n[scheme]\nlevels = \"fixed\"\nstep = 0.1\n"});
  const record::Reader a(folder / "a.h5"), b(folder / "b.h5");
  const report::Comparison comparison = report::compare(a, b);
  CHECK(comparison.only_in[0] == std::vector<std::string>{R"(levels = "variable")"});
  CHECK(comparison.only_in[1] == std::vector<std::string>{R"(levels = "fixed")"});
  CHECK(comparison.lines.front() ==
        std::array<std::string, 3>{"steps", "500, to t = 49.9947525", "300, to t = 29.98023937"});
  const std::string table = report::to_table(comparison), json = report::to_json(comparison);
  CHECK(table.find("discrete energy") != std::string::npos);
  CHECK(json.find(R"("steps": 300)") != std::string::npos);
  CHECK(report::comparison_page(a, b).size() < 5'000'000);

  const report::Comparison itself = report::compare(a, a);
  CHECK((itself.only_in[0].empty() && itself.only_in[1].empty()));
}

TEST_CASE("a record with fewer steps than its levels need is not summed up") {
  const sample::Folder folder;
  const std::string file = folder / "a.h5";
  sample::write_orbit(file, {});
  const auto compared = [&] {
    const record::Reader reader(file);
    static_cast<void>(report::compare(reader, reader));
  };
  CHECK_NOTHROW(compared());
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t energy = H5Dopen2(id, "/levels/energy", H5P_DEFAULT);
  const hsize_t rows = 7;
  REQUIRE(H5Dset_extent(energy, &rows) >= 0);
  H5Dclose(energy);
  H5Fclose(id);
  CHECK_THROWS_WITH(compared(), Catch::Contains("'/levels/energy': it should have 500 rows, but has 7"));
}

TEST_CASE("records with nothing in common are not compared") {
  const sample::Folder folder;
  sample::write_orbit(folder / "orbit.h5", {});
  sample::write_lattice(folder / "line.h5", {});
  sample::write_lattice(folder / "other.h5", {.field = "phi"});
  sample::write_lattice(folder / "plane.h5", {.levels = 5, .nx = 8, .ny = 8});
  const record::Reader orbit(folder / "orbit.h5"), line(folder / "line.h5"), other(folder / "other.h5"),
      plane(folder / "plane.h5");
  CHECK_NOTHROW(report::compare(line, line));
  CHECK_THROWS_WITH(report::compare(orbit, line),
                    Catch::Contains("an orbit in q1") && Catch::Contains("a lattice in u"));
  CHECK_THROWS_AS(report::compare(line, other), std::invalid_argument);
  CHECK_THROWS_AS(report::compare(line, plane), std::invalid_argument);
}
