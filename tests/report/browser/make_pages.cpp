// Writes the pages that the browser test opens into a folder: make_pages FOLDER. Those named broken-… are wrong in one
// way each, and the test has to find it.

#include <cstdio>
#include <filesystem>
#include <stdexcept>
#include <string>

#include <rubato/record/reader.hpp>
#include <rubato/report/comparison.hpp>
#include <rubato/report/page.hpp>

#include "../records.hpp"

namespace {

using namespace rubato;

std::string with(std::string page, const std::string& place, const std::string& addition) {
  const std::size_t at = page.find(place);
  if (at == std::string::npos) {
    throw std::logic_error("the page has no " + place);
  }
  return page.insert(at, addition);
}

/// Without the second half of the numbers of one array.
std::string cut(std::string page) {
  const std::string begin = R"("type":"f64","data":")";
  const std::size_t first = page.find(begin) + begin.size(), last = page.find('"', first);
  return page.erase(first + (last - first) / 8 * 4 + 1, (last - first) / 2);
}

/// With every number of the curves replaced by the one of an undefined value.
std::string emptied(std::string page) {
  const std::string begin = R"("type":"f32","data":")";
  for (std::size_t at = page.find(begin); at != std::string::npos; at = page.find(begin, at)) {
    at += begin.size();
    const std::size_t size = page.find('"', at) - at;
    // "AADAfwAAwH8AAMB/" in base 64 is three times the NaN 7fc00000.
    for (std::size_t i = 0; i + 16 <= size; i += 16) {
      page.replace(at + i, 16, "AADAfwAAwH8AAMB/");
    }
  }
  return page;
}

void write_pages(const std::filesystem::path& folder) {
  const auto record = [&](const std::string& name) { return record::Reader(folder / (name + ".h5")); };
  const auto write = [&](const std::string& name, const std::string& page) {
    report::write_page(folder / (name + ".html"), page, true);
  };
  sample::write_orbit(folder / "orbit.h5", {.dimension = 2, .title = R"(An orbit with </script> & "quotes" — Γ)"});
  sample::write_orbit(folder / "other.h5", {.steps = 400, .dimension = 2, .frequency = 1.1});
  sample::write_orbit(folder / "long-orbit.h5", {.steps = 50000, .dimension = 1});
  sample::write_lattice(folder / "lattice.h5", {.levels = 80});
  sample::write_lattice(folder / "large-lattice.h5",
                        {.levels = 700, .nx = 1001, .spike_level = 300, .spike_cell = 100});
  sample::write_lattice(folder / "plane.h5", {.levels = 25, .nx = 64, .ny = 48});
  for (const char* name : {"orbit", "long-orbit", "lattice", "large-lattice", "plane"}) {
    write(name, report::page(record(name)));
  }
  write("comparison", report::comparison_page(record("orbit"), record("other")));
  write("lattice-comparison", report::comparison_page(record("lattice"), record("large-lattice")));

  const std::string good = report::page(record("lattice"));
  write("broken-cut", cut(good));
  write("broken-empty", emptied(good));
  write("broken-request", with(good, "<main", R"(<img src="elsewhere.png" alt="">)"));
  write("broken-loud", with(good, "rubato.main();", "console.error('loud');"));
  write("broken-mute", with(good, "rubato.main();", "rubato.clock.watch = () => {};"));
  write("broken-rainbow", with(good, "rubato.main();",
                               "rubato.colour.sequential = () => Array.from({length: 256}, (_, i) => [0, 120, 240].map("
                               "(at) => Math.round(255 * Math.max(0, 1 - Math.abs(i - at) / 120))));"));
  write("broken-scheme", with(good, "rubato.main();", "rubato.theme.toggle = () => {};"));
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 2) {
    std::fputs("make_pages FOLDER\n", stderr);
    return 2;
  }
  write_pages(arguments[1]);
  return 0;
}
