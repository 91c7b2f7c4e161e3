// Writes the pages that the browser test opens into a folder: make_pages FOLDER. Those named broken-… are wrong in one
// way each, and the test has to find it.

#include <cstdio>
#include <filesystem>
#include <map>
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
  sample::write_orbit(folder / "short.h5", {.steps = 60, .dimension = 2});
  sample::write_orbit(folder / "other.h5", {.steps = 400, .dimension = 2, .frequency = 1.1});
  sample::write_orbit(folder / "long-orbit.h5", {.steps = 50000, .dimension = 1});
  sample::write_lattice(folder / "lattice.h5", {.levels = 80});
  sample::write_lattice(folder / "large-lattice.h5",
                        {.levels = 700, .nx = 1001, .spike_level = 300, .spike_cell = 100});
  sample::write_lattice(folder / "plane.h5", {.levels = 25, .nx = 64, .ny = 48});
  sample::write_orbit(folder / "bodies.h5",
                      {.dimension = 6, .names = {"sun1", "sun2", "sun3", "moon1", "moon2", "moon3"}});
  sample::write_orbit(folder / "numbered.h5", {.dimension = 4, .names = {"x1", "y1", "x2", "y2"}});
  sample::write_orbit(folder / "section.h5", {.steps = 400, .dimension = 2, .crossings = 3});
  const std::string image = "<img src=x onerror=window.bad=1>";
  sample::write_orbit(folder / "hostile.h5", {.dimension = 2,
                                              .title = "</title><script>window.bad = 1</script><!-- <script> \u2028",
                                              .problem = image + "\u2028</script><!--",
                                              .names = {image, "'\"><script>window.bad=1</script>"}});
  sample::write_orbit(folder / "huge.h5", {.dimension = 2, .names = {"x", "y"}, .size = 1e200});
  sample::write_orbit(folder / "tiny.h5", {.dimension = 2, .names = {"x", "y"}, .size = 1e-200});
  sample::write_lattice(folder / "quiet.h5", {.levels = 40, .residual = 1e-15});
  sample::write_lattice(folder / "holes.h5", {.levels = 40, .nx = 41, .undefined_every = 7});
  sample::write_lattice(folder / "two-fields.h5", {.levels = 30, .nx = 31, .other_field = "a"});
  for (const char* name : {"orbit", "short", "long-orbit", "lattice", "large-lattice", "plane", "bodies", "numbered",
                           "section", "hostile", "huge", "tiny", "holes", "two-fields"}) {
    write(name, report::page(record(name)));
  }
  const report::PageOptions small{.max_bytes = 350'000};
  write("thinned", report::page(record("long-orbit"), small));
  const std::map<std::string, double> levels{{"/laws/fields/energy", 1e-13}, {"/laws/energy_max", 1e-13}};
  write("quiet", report::page(record("quiet"), {.notes = [&](const record::Reader&) {
                                return report::Notes{.fields = {}, .rounding = levels};
                              }}));
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
  const std::string orbit = report::page(record("orbit"));
  write("broken-dots", with(report::page(record("short")), "rubato.main();",
                            "CanvasRenderingContext2D.prototype.lineTo = function (x, y) {"
                            "this.fillRect(x - 0.75, y - 0.75, 1.5, 1.5); this.moveTo(x, y); };"));
  write("broken-choice", with(orbit, "rubato.main();", "rubato.choose = () => document.createElement('span');"));
  write("broken-legend", with(report::page(record("bodies")), "rubato.main();", "rubato.legend = () => {};"));
  write("broken-bright", report::page(record("quiet")));
  write("broken-hidden",
        with(report::page(record("holes")), "rubato.main();", "rubato.colour.undefinedAt = () => [255, 255, 255];"));
  write("broken-uncounted",
        with(report::page(record("holes")), "rubato.main();", "rubato.undefinedNote = () => null;"));
  write("broken-silent",
        with(report::page(record("long-orbit"), small), "rubato.main();", "rubato.thinningNote = () => null;"));
  write("broken-order", report::page(record("two-fields"), {.notes = [](const record::Reader&) {
                                       return report::Notes{.fields = {"a"}, .rounding = {}};
                                     }}));
  write("broken-faint",
        with(good, "rubato.main();", "document.documentElement.style.setProperty('--faint', '#c0c0c0');"));
  write("broken-nameless",
        with(good, "rubato.main();",
             "rubato.button = (text, label, action) => rubato.element('button', { click: action });"));
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
