// What the page of a record has to show of problems that were once drawn wrongly.

#include <algorithm>
#include <cmath>
#include <string>

#include <catch2/catch.hpp>

#include <rubato/report/page.hpp>
#include <rubato/run/record_notes.hpp>
#include <rubato/run/run.hpp>

#include "defects.hpp"
#include "record/sample.hpp"
#include "report/page_reader.hpp"

using namespace rubato;
using rubato::defect_tests::defect_file;

namespace {

std::string data_of_run(const rubato::Problem& problem) {
  const sample::Folder folder;
  REQUIRE(rubato::run(problem, {.output = (folder / "record.h5").string()}).status == rubato::ExitStatus::done);
  const auto notes = [](const record::Reader& reader) {
    const rubato::RecordNotes known = rubato::notes_on(reader);
    return report::Notes{known.fields, known.rounding};
  };
  return sample::data_of(report::page(record::Reader(folder / "record.h5"), {.notes = notes}));
}

}  // namespace

TEST_CASE("a law without a value in some cells is striped there, and its page says in how many") {
  const std::string data = data_of_run(rubato::read_problem(defect_file("undefined-law.toml")));
  // 33 cells in each of 5 steps; log(u) has no value in two of them.
  const std::string_view momentum = sample::after(data, {R"("maps":)", R"("name":"momentum","group":"residual")"});
  CHECK(momentum.starts_with(R"(,"count":165,"undefined":10,)"));
  const std::vector<double> codes = sample::numbers_after(momentum, {R"("values":)"});
  CHECK(std::ranges::count(codes, 65535.0) == 33 + 10);  // before the first step there is none at all
  // The same with u never at -1, where the logarithm ends.
  const std::string sound = data_of_run(
      rubato::read_problem(defect_file("undefined-law.toml"), std::vector<std::string>{"initial.u=0.3*cos(x)"}));
  const std::string_view whole = sample::after(sound, {R"("maps":)", R"("name":"momentum","group":"residual")"});
  CHECK(whole.starts_with(R"(,"count":165,"undefined":0,)"));
  CHECK(std::ranges::count(sample::numbers_after(whole, {R"("values":)"}), 65535.0) == 33);
  const std::string_view energy = sample::after(data, {R"("maps":)", R"("name":"energy","group":"residual")"});
  CHECK(energy.starts_with(R"(,"count":165,"undefined":0,)"));
}
