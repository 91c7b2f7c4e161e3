// What the page of a record has to show of problems that were once drawn wrongly.

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/report/page.hpp>
#include <rubato/report/xdmf.hpp>
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
    return report::Notes{known.fields, known.auxiliary, known.rounding};
  };
  return sample::data_of(report::page(record::Reader(folder / "record.h5"), {.notes = notes}));
}

}  // namespace

TEST_CASE("a law without a value in some cells is striped there, and its page says in how many") {
  const auto data_with = [](const std::vector<std::string>& settings) {
    return data_of_run(rubato::read_problem(defect_file("undefined-law.toml"), settings));
  };
  const std::string data = data_with({"laws.fields=true"});
  // 33 cells in each of 5 steps; log(u) has no value in two of them.
  const std::string_view momentum = sample::after(data, {R"("maps":)", R"("name":"momentum","group":"residual")"});
  CHECK(momentum.starts_with(R"(,"count":165,"undefined":10,)"));
  const std::vector<double> codes = sample::numbers_after(momentum, {R"("values":)"});
  CHECK(std::ranges::count(codes, 65535.0) == 33 + 10);  // before the first step there is none at all
  // The same with u never at -1, where the logarithm ends.
  const std::string sound = data_with({"laws.fields=true", "initial.u=0.3*cos(x)"});
  const std::string_view whole = sample::after(sound, {R"("maps":)", R"("name":"momentum","group":"residual")"});
  CHECK(whole.starts_with(R"(,"count":165,"undefined":0,)"));
  CHECK(std::ranges::count(sample::numbers_after(whole, {R"("values":)"}), 65535.0) == 33);
  const std::string_view energy = sample::after(data, {R"("maps":)", R"("name":"energy","group":"residual")"});
  CHECK(energy.starts_with(R"(,"count":165,"undefined":0,)"));
}

TEST_CASE("a quantity at nodes is on the page, at the output times, and in XDMF") {
  const rubato::Problem problem = rubato::read_problem(defect_file("user-node-quantities.toml"));
  const std::string data = data_of_run(problem);
  const std::string_view density =
      sample::after(data, {R"("quantity_maps":)", R"("name":"density","group":"quantity")"});
  CHECK(density.starts_with(R"(,"count":4221,"undefined":0,)"));  // 21 output times and 201 nodes
  const std::vector<double> times = sample::numbers_after(data, {R"("quantity_map_times":)", R"("first":)"});
  CHECK(times.front() == 0.0);
  CHECK(times.back() == 10.0);
  // Of a quantity that is 0, or of a run without one, it is not.
  const std::string zero = data_of_run(rubato::read_problem(defect_file("user-node-quantities.toml"),
                                                            std::vector<std::string>{"output.quantities.density=0*u"}));
  CHECK(sample::numbers_after(zero, {R"("quantity_maps":)", R"("values":)"}) !=
        sample::numbers_after(data, {R"("quantity_maps":)", R"("values":)"}));
  CHECK(data_of_run(rubato::read_problem("sine-gordon", std::vector<std::string>{"scheme.until=0.2"}))
            .find("quantity_maps") == std::string::npos);

  const sample::Folder folder;
  REQUIRE(rubato::run(problem, {.output = (folder / "record.h5").string()}).status == rubato::ExitStatus::done);
  report::export_xdmf(record::Reader(folder / "record.h5"), folder / "record.xdmf");
  std::ifstream file(folder / "record.xdmf");
  const std::string xdmf{std::istreambuf_iterator<char>(file), {}};
  const std::string_view grids = sample::after(xdmf, {R"(Name="quantities")"});
  CHECK(grids.find(R"(<Time Value="9.5"/>)") != std::string_view::npos);
  CHECK(grids.find("record.h5:/output/quantities/density<") != std::string_view::npos);
}
