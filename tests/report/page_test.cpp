#include <fstream>
#include <regex>

#include <catch2/catch.hpp>

#include <rubato/record/reader.hpp>
#include <rubato/report/assets.hpp>
#include <rubato/report/contents.hpp>
#include <rubato/report/page.hpp>
#include <rubato/report/summary.hpp>

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
  const std::string nasty = R"(</script><script>window.bad=1</script> "quoted" {{data}} {{script}} Γ θ̇ 𝕃)";
  sample::write_orbit(folder / "nasty.h5", {.title = nasty, .problem = "title = '''" + nasty + "'''\n# <!-- & -->\n"});
  sample::write_orbit(folder / "plain.h5", {});
  const std::string page = page_of(folder / "nasty.h5"), plain = page_of(folder / "plain.h5");
  CHECK(count(page, "</script>") == count(plain, "</script>"));
  CHECK(count(page, "<script") == count(plain, "<script"));
  CHECK(page.find("<title>&lt;/script&gt;") != std::string::npos);
  CHECK(page.find("{{data}} {{script}} Γ θ̇ 𝕃") != std::string::npos);
  // The same checks see a page that was put together without escaping.
  std::string careless = plain;
  careless.insert(careless.find("</title>"), nasty);
  CHECK(count(careless, "</script>") != count(plain, "</script>"));
}

TEST_CASE("a page stays below its size, and thins only where it must") {
  const sample::Folder folder;
  sample::write_orbit(folder / "orbit.h5", {.steps = 60000, .dimension = 3});
  const std::string page = page_of(folder / "orbit.h5");
  CHECK(page.size() < 5'000'000);
  const std::string small = page_of(folder / "orbit.h5", {.max_bytes = 500'000});
  CHECK(small.size() < 500'000);
  CHECK(small.size() < page.size());
  const std::string full = page_of(folder / "orbit.h5", {.full = true});
  CHECK(full.size() > 5'000'000);  // so that the bound above is one that this record can break

  sample::write_lattice(folder / "lattice.h5", {.levels = 400, .nx = 1001});
  CHECK(page_of(folder / "lattice.h5").size() < 5'000'000);
  CHECK(page_of(folder / "lattice.h5", {.max_bytes = 1'000'000}).size() < 1'000'000);
  sample::write_lattice(folder / "small.h5", {.levels = 100, .nx = 201});
  CHECK(page_of(folder / "small.h5").find(R"("thinned":true)") == std::string::npos);
  CHECK(page_of(folder / "lattice.h5", {.max_bytes = 1'000'000}).find(R"("thinned":true)") != std::string::npos);
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

TEST_CASE("a record that has only just begun has a page") {
  const sample::Folder folder;
  sample::write_orbit(folder / "start.h5", {.steps = 0, .with_exact = false});
  sample::write_lattice(folder / "first.h5", {.levels = 1});
  CHECK(page_of(folder / "start.h5").size() > 100'000);
  CHECK(page_of(folder / "first.h5").size() > 100'000);
}

TEST_CASE("the summary has the figures of the record") {
  const sample::Folder folder;
  sample::write_orbit(folder / "orbit.h5", {.spike = 321});
  const record::Reader reader(folder / "orbit.h5");
  const report::Contents contents = report::contents_of(reader);
  CHECK(contents.kind == report::Contents::Kind::orbit);
  CHECK(contents.invariants == std::vector<std::string>{"momentum"});
  CHECK(contents.residuals == std::vector<std::string>{"energy"});
  const report::Summary summary = report::summarise(reader, contents);
  CHECK(summary.steps == 500);
  CHECK(summary.bridge_steps == 15);  // three in every hundred
  CHECK(summary.bridge_deviation == Approx(1e-4));
  CHECK(summary.discrete_energy.max < 3e-15);
  CHECK(summary.node_energy.max > 0.99);
  REQUIRE(summary.errors.size() == 1);
  // The last level is at t = 50 + 0.02 sin 50, and the error there is 1e-4 t.
  CHECK(summary.errors[0].max == Approx(1e-4 * (50.0 + 0.02 * std::sin(50.0))));
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
