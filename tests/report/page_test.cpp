#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <regex>

#include <fmt/format.h>
#include <hdf5.h>
#include <catch2/catch.hpp>

#include <rubato/record/reader.hpp>
#include <rubato/report/assets.hpp>
#include <rubato/report/comparison.hpp>
#include <rubato/report/contents.hpp>
#include <rubato/report/page.hpp>

#include "page_reader.hpp"
#include "record/sample.hpp"
#include "records.hpp"

using namespace rubato;

namespace {

std::string page_of(const std::filesystem::path& file, const report::PageOptions& options = {}) {
  return report::page(record::Reader(file), options);
}

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) {
    ++found;
  }
  return found;
}

/// Whether nothing in a page can make a browser ask for anything. uPlot names its home in a comment.
bool asks_for_nothing(std::string page) {
  const std::string banner = "/*! https://github.com/leeoniya/uPlot";
  if (const std::size_t at = page.find(banner); at != std::string::npos) {
    page.erase(at, banner.size());
  }
  static const std::regex reference(
      R"re((src\s*=|href\s*=\s*"[^#d]|@import|url\(|https?:|import\s*\(|fetch\s*\(|XMLHttpRequest))re");
  return !std::regex_search(page.substr(0, page.find(R"(<script id="data")")), reference);
}

}  // namespace

TEST_CASE("a page asks the network for nothing") {
  const sample::Folder folder;
  sample::write_orbit(folder / "orbit.h5", {});
  const std::string page = page_of(folder / "orbit.h5");
  CHECK(asks_for_nothing(page));
  const std::size_t head = page.find("</head>");
  for (const std::string bad :
       {R"(<script src="x.js"></script>)", R"(<link rel="stylesheet" href="https://example.org/a.css">)",
        R"(<style>@import "a.css";</style>)", "<style>a { background: url(b.png) }</style>"}) {
    CHECK_FALSE(asks_for_nothing(std::string(page).insert(head, bad)));
  }
}

TEST_CASE("what a record says cannot become part of the page's code") {
  const sample::Folder folder;
  // U+2028 ends a line of JavaScript, but not of JSON; a comment opened in a script hides its end.
  const std::string nasty =
      "</script><script>window.bad=1</script> <!-- <script> \"quoted\" {{data}} {{script}} Γ θ̇ 𝕃 \u2028\u2029";
  sample::write_orbit(folder / "nasty.h5", {.title = nasty, .problem = "title = '''" + nasty + "'''\n# <!-- & -->\n"});
  sample::write_orbit(folder / "plain.h5", {});
  const std::string page = page_of(folder / "nasty.h5"), plain = page_of(folder / "plain.h5");
  const auto is_code_of = [&](const std::string& text) {
    return count(text, "</script>") == count(plain, "</script>") && count(text, "<script") == count(plain, "<script") &&
           count(text, "<!--") == count(plain, "<!--");
  };
  CHECK(is_code_of(page));
  CHECK(sample::data_of(page).find('<') == std::string::npos);
  CHECK(page.find("<title>&lt;/script&gt;") != std::string::npos);
  CHECK(page.find("{{data}} {{script}} Γ θ̇ 𝕃") != std::string::npos);
  // The same checks see pages that were put together without escaping.
  for (const char* place : {"</title>", R"(,"problem":)"}) {
    std::string careless = plain;
    careless.insert(careless.find(place), nasty);
    CHECK_FALSE(is_code_of(careless));
  }
}

TEST_CASE("a page has at most the size it may have, and uses it") {
  const sample::Folder folder;
  const std::string name = GENERATE("orbit", "many", "section", "lattice", "long", "plane", "volume");
  const std::map<std::string, sample::OrbitRecord> orbits{{"orbit", {.steps = 60000, .dimension = 3}},
                                                          {"many", {.steps = 4000, .dimension = 40}},
                                                          {"section", {.steps = 2000, .crossings = 100}}};
  if (orbits.contains(name)) {
    sample::write_orbit(folder / name, orbits.at(name));
  } else {
    const std::map<std::string, sample::LatticeRecord> lattices{
        {"lattice", {.levels = 400, .nx = 1001}},
        {"long", {.levels = 20000, .nx = 15}},
        {"plane", {.levels = 60, .nx = 128, .ny = 128}},
        {"volume", {.levels = 60, .nx = 64, .ny = 48, .nz = 3}},
    };
    sample::write_lattice(folder / name, lattices.at(name));
  }
  CAPTURE(name);
  const std::size_t full = page_of(folder / name, {.full = true}).size();
  for (const std::size_t size : {600'000U, 2'000'000U, 5'000'000U}) {
    CAPTURE(size, full);
    const std::size_t bytes = page_of(folder / name, {.max_bytes = size}).size();
    CHECK(bytes <= size);
    // Beyond rounding to whole rows, blocks and frames, only what the record does not need is left.
    CHECK(bytes >= std::min<std::size_t>(full, size * 7 / 10));
  }
  CHECK(page_of(folder / name, {.max_bytes = full + 100'000}).size() == full);
  CHECK(full > 1'000'000);  // so that the bounds above are ones that this record can break
}

TEST_CASE("two records share a page") {
  const sample::Folder folder;
  sample::write_orbit(folder / "long.h5", {.steps = 30000});
  sample::write_orbit(folder / "short.h5", {.steps = 50});
  const record::Reader a(folder / "long.h5"), b(folder / "short.h5");
  const std::string page = report::comparison_page(a, b, {.max_bytes = 1'000'000});
  CHECK(page.size() <= 1'000'000);
  CHECK(page.size() > 700'000);  // what the short one does not need is the long one's
  CHECK_THROWS_WITH(report::comparison_page(a, b, {.max_bytes = 1000}), Catch::Contains("these records need at least"));
}

TEST_CASE("too small a page is refused with the least that is possible") {
  const sample::Folder folder;
  sample::write_orbit(folder / "orbit.h5", {.steps = 20000, .dimension = 3});
  sample::write_lattice(folder / "plane.h5", {.levels = 100, .nx = 128, .ny = 128});
  const std::string name = GENERATE("orbit.h5", "plane.h5");
  std::size_t least = 0;
  try {
    static_cast<void>(page_of(folder / name, {.max_bytes = 100'000}));
  } catch (const std::invalid_argument& error) {
    static const std::regex pattern(R"(a page of 0\.1 MB is too small: this record needs at least ([0-9.]+) MB)");
    std::smatch match;
    const std::string message = error.what();
    REQUIRE(std::regex_match(message, match, pattern));
    least = static_cast<std::size_t>(std::lround(std::stod(match[1]) * 1e6));
  }
  REQUIRE(least > 100'000);
  CHECK(page_of(folder / name, {.max_bytes = least}).size() <= least);
  CHECK_THROWS_AS(page_of(folder / name, {.max_bytes = least - 10'000}), std::invalid_argument);
}

TEST_CASE("a page thins only where it must") {
  const sample::Folder folder;
  sample::write_lattice(folder / "small.h5", {.levels = 100, .nx = 201});
  sample::write_orbit(folder / "orbit.h5", {.steps = 20000, .dimension = 2});
  sample::write_lattice(folder / "plane.h5", {.levels = 60, .nx = 81, .ny = 81});
  CHECK(page_of(folder / "small.h5").find(R"("thinned":true)") == std::string::npos);
  CHECK(page_of(folder / "small.h5", {.max_bytes = 250'000}).find(R"("thinned":true)") != std::string::npos);
  const std::string page = sample::data_of(page_of(folder / "orbit.h5"));
  CHECK(sample::numbers_after(page, {R"("states":)", R"("t":)"}).size() == 20001);
  CHECK(sample::numbers_after(page, {R"("name":"gamma")", R"("y":)"}).size() == 20001);
  const std::string small = sample::data_of(page_of(folder / "orbit.h5", {.max_bytes = 500'000}));
  CHECK(sample::numbers_after(small, {R"("states":)", R"("t":)"}).size() < 20001);
  // Pictures of 81 by 81 nodes keep them all; of the levels some are left out.
  const std::string plane = sample::data_of(page_of(folder / "plane.h5", {.max_bytes = 2'000'000}));
  CHECK(plane.find(R"("shape":"film","thinned":false)") != std::string::npos);
  CHECK(plane.find(R"("count":60,"parts":60)") == std::string::npos);
}

TEST_CASE("a section is on the page with all of its points, or with every n-th") {
  const sample::Folder folder;
  sample::write_orbit(folder / "orbit.h5", {.steps = 1000, .crossings = 30});
  const std::string page = sample::data_of(page_of(folder / "orbit.h5"));
  const std::vector<double> y = sample::numbers_after(page, {R"("name":"section","count":30000)", R"("name":"y")"}),
                            v = sample::numbers_after(page, {R"("name":"section")", R"("name":"v")"});
  REQUIRE(y.size() == 30000);
  REQUIRE(v.size() == 30000);
  CHECK(y[29999] == static_cast<float>(record::Reader(folder / "orbit.h5").read("/events/section/quantities")[59998]));
  CHECK_THAT(page, Catch::Contains("event section") && Catch::Contains("30000, from t ="));
  const std::string small = sample::data_of(page_of(folder / "orbit.h5", {.max_bytes = 300'000}));
  const std::vector<double> fewer =
      sample::numbers_after(small, {R"("name":"section","count":30000)", R"("name":"y")"});
  REQUIRE(fewer.size() < 30000);
  CHECK(fewer.size() > 1000);
  const std::size_t stride = (30000 - 1) / fewer.size() + 1;
  CHECK(fewer.back() == y[(fewer.size() - 1) * stride]);
  // The twin: a record without one.
  sample::write_orbit(folder / "none.h5", {.steps = 1000});
  CHECK_THAT(sample::data_of(page_of(folder / "none.h5")), Catch::Contains(R"("sections":[])"));
}

TEST_CASE("a spike reaches the page, however much is thinned") {
  const sample::Folder folder;
  sample::write_lattice(folder / "spike.h5", {.levels = 300, .nx = 301, .spike_level = 123, .spike_cell = 77});
  sample::write_lattice(folder / "flat.h5", {.levels = 300, .nx = 301});
  const auto shows_spike = [&](const std::string& name) {
    return page_of(folder / name, {.max_bytes = 700'000}).find(R"("maximum":100,)") != std::string::npos;
  };
  CHECK(shows_spike("spike.h5"));
  CHECK_FALSE(shows_spike("flat.h5"));
}

TEST_CASE("what is undefined is counted and shown, however much is thinned") {
  const sample::Folder folder;
  sample::write_lattice(folder / "holes.h5", {.levels = 300, .nx = 301, .undefined_every = 7});
  sample::write_lattice(folder / "sound.h5", {.levels = 300, .nx = 301});
  const std::size_t size = GENERATE(std::size_t{300'000}, std::size_t{5'000'000});
  const std::string page = sample::data_of(page_of(folder / "holes.h5", {.max_bytes = size}));
  // Of 299 steps, the 42 whose level is a multiple of 7 have one cell without a value, and no momentum.
  CHECK(sample::after(page, {R"("maps":)", R"("group":"residual")"}).starts_with(R"(,"count":89999,"undefined":42,)"));
  CHECK(sample::after(page, {R"("name":"momentum")"}).find(R"("count":300,"undefined":42)") != std::string_view::npos);
  const auto striped = [](const std::string& data) {
    const std::vector<double> codes =
        sample::numbers_after(data, {R"("maps":)", R"("group":"residual")", R"("values":)"});
    return std::ranges::count(codes, 65535.0);
  };
  const std::string sound = sample::data_of(page_of(folder / "sound.h5", {.max_bytes = size}));
  CHECK(striped(page) > striped(sound) + 10);
  CHECK(sound.find(R"("undefined":42)") == std::string::npos);
}

TEST_CASE("the unknown comes first, and what rounding leaves is told") {
  const sample::Folder folder;
  sample::write_lattice(folder / "lattice.h5", {.field = "u", .other_field = "a"});
  const auto first_field = [&](const report::PageOptions& options) {
    const std::string data = sample::data_of(page_of(folder / "lattice.h5", options));
    const std::string_view name = sample::after(data, {R"("maps":[{"name":")"});
    return std::string(name.substr(0, name.find('"')));
  };
  CHECK(first_field({}) == "u");  // which has an exact solution; in the record "a" comes before it
  const auto notes = [](const record::Reader&) {
    return report::Notes{.fields = {"a", "u"},
                         .rounding = {{"/laws/fields/energy", 0.125}, {"/laws/energy_max", 0.125}}};
  };
  CHECK(first_field({.notes = notes}) == "a");
  const std::string data = sample::data_of(page_of(folder / "lattice.h5", {.notes = notes}));
  CHECK(count(data, R"("rounding":0.125)") == 2);
  CHECK(sample::after(data, {R"("name":"energy max")"}).substr(0, 100).find(R"("rounding":0.125)") !=
        std::string_view::npos);
}

TEST_CASE("fields that nobody stated are drawn where they are asked for") {
  const sample::Folder folder;
  sample::write_lattice(folder / "lattice.h5", {.field = "u", .other_field = "a"});
  const auto drawn = [&](const report::PageOptions& options) {
    return count(sample::data_of(page_of(folder / "lattice.h5", options)), R"("name":"a","group":"field")");
  };
  const auto notes = [](const record::Reader&) {
    return report::Notes{.fields = {"u"}, .auxiliary = {"a"}, .rounding = {}};
  };
  CHECK(drawn({}) == 1);
  CHECK(drawn({.notes = notes}) == 0);
  CHECK(drawn({.field = "a", .notes = notes}) == 1);
}

TEST_CASE("planes and volumes become films") {
  const sample::Folder folder;
  sample::write_lattice(folder / "plane.h5", {.levels = 30, .nx = 64, .ny = 48});
  sample::write_lattice(folder / "volume.h5", {.levels = 10, .nx = 24, .ny = 20, .nz = 16});
  const std::string plane = page_of(folder / "plane.h5"), volume = page_of(folder / "volume.h5");
  CHECK(count(plane, R"("shape":"film")") == 3);
  CHECK(count(plane, R"("slice":)") == 0);
  CHECK(count(volume, R"("slice":{"axis":"z","at":)") == 3);
  sample::write_lattice(folder / "long.h5", {.levels = 200, .nx = 128, .ny = 128});
  CHECK(page_of(folder / "long.h5").size() < 5'000'000);
}

TEST_CASE("the first field of a large plane is drawn at every node, or the one asked for") {
  const sample::Folder folder;
  sample::write_lattice(folder / "plane.h5", {.levels = 60, .nx = 255, .ny = 255, .other_field = "w"});
  const auto is_whole = [&](const report::PageOptions& options, const std::string& field) {
    const std::string page = page_of(folder / "plane.h5", options);
    CHECK(page.size() <= options.max_bytes);
    const std::string_view film =
        sample::after(page, {R"("maps":)", fmt::format(R"("name":"{}","group":"field")", field), R"("shape":"film")"});
    const bool whole = film.starts_with(R"(,"thinned":false)");
    const std::vector<double> codes = sample::numbers_after(film, {R"("values":)"});
    CHECK((codes.size() % (255 * 255) == 0) == whole);
    CHECK((!whole || codes.size() >= 8 * 255 * 255));
    return whole;
  };
  CHECK(is_whole({}, "u"));
  CHECK_FALSE(is_whole({}, "w"));
  CHECK(is_whole({.field = "w"}, "w"));
  CHECK_FALSE(is_whole({.field = "w"}, "u"));
  // The twin: no room for eight pictures of 255² nodes with 16 bits in base 64, 1.4 MB.
  CHECK_FALSE(is_whole({.max_bytes = 1'000'000}, "u"));
  CHECK_THROWS_WITH(page_of(folder / "plane.h5", {.field = "v"}), Catch::Contains("no such field; it has u, w"));
}

TEST_CASE("a record that has only just begun has a page with its first level") {
  const sample::Folder folder;
  sample::write_orbit(folder / "start.h5", {.steps = 0, .with_exact = false});
  sample::write_lattice(folder / "first.h5", {.levels = 1, .nx = 11});
  const std::string orbit = sample::data_of(page_of(folder / "start.h5"));
  CHECK(sample::numbers_after(orbit, {R"("name":"gamma")", R"("y":)"}) == std::vector{1.5});  // 1.5 + sin 0
  CHECK(sample::numbers_after(orbit, {R"("states":)", R"("t":)"}) == std::vector{0.0});
  CHECK(orbit.find(R"("name":"h")") == std::string::npos);  // there is no step yet
  const std::string lattice = sample::data_of(page_of(folder / "first.h5"));
  const std::vector<double> codes =
      sample::numbers_after(lattice, {R"("maps":)", R"("name":"u","group":"field")", R"("values":)"});
  REQUIRE(codes.size() == 11);
  CHECK(std::ranges::max(codes) == 65534.0);
  CHECK(std::ranges::min(codes) == 0.0);
  CHECK(sample::numbers_after(lattice, {R"("group":"residual")", R"("values":)"}) == std::vector(11, 65535.0));
}

TEST_CASE("residuals of the cells between walls, of which there is one less than nodes, are drawn in full") {
  const sample::Folder folder;
  const auto counts_of = [&](const sample::LatticeRecord& lattice) {
    sample::write_lattice(folder / "walls.h5", lattice);
    const std::string data = sample::data_of(page_of(folder / "walls.h5"));
    const auto values_of = [&](const char* group) {
      return sample::numbers_after(data, {R"("maps":)", group, R"("values":)"}).size();
    };
    return std::pair(values_of(R"("group":"field")"), values_of(R"("group":"residual")"));
  };
  CHECK(counts_of({.levels = 5, .nx = 11, .walls = true}) == std::pair<std::size_t, std::size_t>(55, 50));
  CHECK(counts_of({.levels = 5, .nx = 6, .ny = 4, .walls = true}) == std::pair<std::size_t, std::size_t>(120, 75));
  // The twin: periods.
  CHECK(counts_of({.levels = 5, .nx = 11}) == std::pair<std::size_t, std::size_t>(55, 55));
}

TEST_CASE("an error is the difference of double numbers") {
  const sample::Folder folder;
  sample::write_orbit(folder / "orbit.h5", {.steps = 100});
  const std::string data = sample::data_of(page_of(folder / "orbit.h5"));
  const std::vector<double> error = sample::numbers_after(data, {R"("name":"q1","group":"error")", R"("y":)"});
  const std::vector<double> t = sample::numbers_after(data, {R"("times":)", R"("states":)"});
  REQUIRE(error.size() == 101);
  double largest = 0.0;
  for (std::size_t k = 0; k < error.size(); ++k) {
    largest = std::max(largest, std::abs(error[k] + 1e-4 * t[k]));
  }
  // Single precision of the error itself, at most 1e-3, and not of the coordinate, which is about 1.
  CHECK(largest < 1e-3 * 6e-8);
}

TEST_CASE("a record whose parts do not fit has no page") {
  const sample::Folder folder;
  sample::write_orbit(folder / "orbit.h5", {.steps = 100, .crossings = 2});
  sample::write_lattice(folder / "lattice.h5", {.levels = 20, .nx = 31});
  const auto [name, dataset] = GENERATE(table<std::string, std::string>({{"orbit.h5", "/laws/momentum"},
                                                                         {"orbit.h5", "/states/q"},
                                                                         {"orbit.h5", "/exact/q1"},
                                                                         {"orbit.h5", "/events/section/missed"},
                                                                         {"orbit.h5", "/events/section/quantities"},
                                                                         {"lattice.h5", "/states/u"},
                                                                         {"lattice.h5", "/exact/u"},
                                                                         {"lattice.h5", "/laws/fields/energy"}}));
  CAPTURE(name, dataset);
  CHECK_NOTHROW(page_of(folder / name));
  const hid_t file = H5Fopen((folder / name).c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t set = H5Dopen2(file, dataset.c_str(), H5P_DEFAULT);
  const hid_t space = H5Dget_space(set);
  std::array<hsize_t, 4> shape{};
  H5Sget_simple_extent_dims(space, shape.data(), nullptr);
  shape[0] -= 3;
  REQUIRE(H5Dset_extent(set, shape.data()) >= 0);
  H5Sclose(space);
  H5Dclose(set);
  H5Fclose(file);
  CHECK_THROWS_AS(page_of(folder / name), record::Error);
}

TEST_CASE("the summary has the figures of the record") {
  const sample::Folder folder;
  sample::write_orbit(folder / "orbit.h5", {.spike = 321});
  const record::Reader reader(folder / "orbit.h5");
  const report::Contents contents = report::contents_of(reader);
  CHECK(contents.kind == report::Contents::Kind::orbit);
  CHECK(contents.invariants == std::vector<std::string>{"momentum"});
  CHECK(contents.residuals == std::vector<std::string>{"energy"});
  const figures::Statistics summary = report::summarise(reader, contents);
  CHECK(summary.steps == 500);
  CHECK(summary.off_law_steps == 15);  // three in every hundred
  CHECK(summary.off_law_deviation() == Approx(1e-4));
  CHECK(summary.energy_deviation() < 3e-15);
  CHECK(summary.node_energy.max() > 0.99);
  REQUIRE(summary.errors.size() == 1);
  // The last level is at t = 50 + 0.02 sin 50, and the error there is 1e-4 t.
  CHECK(summary.errors[0].value.max == Approx(1e-4 * (50.0 + 0.02 * std::sin(50.0))));
}

TEST_CASE("only pages of this library are replaced unasked") {
  const sample::Folder folder;
  sample::write_orbit(folder / "orbit.h5", {});
  const std::string page = page_of(folder / "orbit.h5");
  report::write_page(folder / "page.html", page);
  CHECK_NOTHROW(report::write_page(folder / "page.html", page));
  std::ofstream(folder / "mine.html") << "<p>my own</p>";
  CHECK_THROWS_AS(report::write_page(folder / "mine.html", page), record::AlreadyExists);
  CHECK_NOTHROW(report::write_page(folder / "mine.html", page, true));
  CHECK(std::filesystem::file_size(folder / "mine.html") == page.size());
  CHECK_THROWS_AS(report::write_page(folder / "no" / "page.html", page), record::Error);
  std::size_t files = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder.path())) {
    ++files;
  }
  CHECK(files == 3);  // nothing is left behind
}
