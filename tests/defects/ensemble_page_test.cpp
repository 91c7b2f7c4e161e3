// The page of an ensemble: here, since it takes those who run and those who draw.

#include <catch2/catch.hpp>

#include <stdexcept>
#include <string>

#include <rubato/record/reader.hpp>
#include <rubato/report/page.hpp>
#include <rubato/run/ensemble.hpp>

#include "record/sample.hpp"

using namespace rubato;
using Catch::Contains;

namespace {

const std::string swing = R"toml([hamiltonian]
q = ["q"]
p = ["p"]
H = "p^2/2 - cos(q)"
[initial]
q = 0
p = 1
[scheme]
step = 0.1
until = 20
[output]
interval = 0.5
[events]
left = { crossing = "q < -1", stop = true }
right = { crossing = "q > 1.5", stop = true }
[section]
crossing = "q"
quantities = ["p", "2*p"]
[ensemble]
grid = { initial.p = "0.5:2.5:4", scheme.levels = ["variable", "fixed"] }
)toml";

std::string page_of(const std::string& text, const report::PageOptions& options = {}) {
  const sample::Folder folder;
  const std::string file = (folder / "all.h5").string();
  static_cast<void>(rubato::run_ensemble(rubato::parse_problem(text, "t.toml"), {.output = file}));
  return report::page(record::Reader(file), options);
}

}  // namespace

TEST_CASE("the page of an ensemble has its members, orbits and sections") {
  const std::string page = page_of(swing);
  CHECK_THAT(page, Contains(R"("kind":"ensemble")") && Contains(R"("members":{"count":8,"stride":1)"));
  CHECK_THAT(page, Contains(R"({"name":"initial.p","group":"given","label":"initial.p","words":[])"));
  CHECK_THAT(
      page,
      Contains(
          R"("name":"scheme.levels","group":"given","label":"scheme.levels","words":["\"variable\"","\"fixed\""])"));
  CHECK_THAT(page, Contains(R"("label":"ended by the event","words":["left","right"])"));
  CHECK_THAT(page, Contains(R"("path_members":{"count":8,"shown":8})") && Contains(R"("sections":[{"name":"section")"));
  CHECK_THAT(page, Contains(R"(["members","8","",true])") && Contains("half in"));
  // The twin: without output times and events there is nothing of them.
  std::string bare = swing.substr(0, swing.find("[output]")) + swing.substr(swing.find("[ensemble]"));
  CHECK_THAT(page_of(bare),
             Contains(R"("paths":[])") && Contains(R"("sections":[])") && !Contains("ended by the event"));
}

TEST_CASE("the page of an ensemble is as large as it may be, and says what is left out") {
  std::string fine = swing;
  fine.replace(fine.find("interval = 0.5"), 14, "interval = 0.05");
  const std::string whole = page_of(fine);
  const std::size_t most = whole.size() - 8000;  // about half of its numbers
  const std::string thinned = page_of(fine, {.max_bytes = most});
  CHECK(thinned.size() <= most);
  CHECK(thinned.size() > most - 8000);
  CHECK_THAT(whole, Contains(R"("path_members":{"count":8,"shown":8})"));
  CHECK_THAT(thinned, Contains(R"("path_members":{"count":8,)") && !Contains(R"("shown":8})"));
  CHECK_THROWS_WITH(page_of(swing, {.max_bytes = 10000}), Contains("this record needs at least"));
}
