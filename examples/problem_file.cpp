// What the program does, done from C++: read a problem, run it into a record, check the record from its states alone,
// and read numbers out of it.

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <string>

#include <fmt/format.h>

#include <rubato/rubato.hpp>

int main() {
  const std::string file = (std::filesystem::temp_directory_path() / "rubato-example-problem_file.h5").string();

  const rubato::Problem problem = rubato::read_problem("henon-heiles", std::vector<std::string>{"scheme.until=50"});
  const rubato::Outcome run = rubato::run(problem, {.output = file, .overwrite = true});
  const rubato::Outcome check = rubato::check(file);
  fmt::print("{}\nand again, from the states alone:\n\n{}\n", rubato::to_table(run), rubato::to_table(check));

  const rubato::record::Reader record(file);
  const std::vector<double> t = record.read("/levels/t");
  fmt::print("{} levels, the last at t = {:.4f}\n", t.size(), t.back());
  std::remove(file.c_str());

  // The run meets the tolerance of the level equation, 1e-13 relative, and its record agrees with itself.
  const bool as_expected = run.status == rubato::ExitStatus::done && t.size() == run.statistics.steps + 1 &&
                           run.statistics.energy_deviation() <= 1e-13 * run.statistics.energy_scale() &&
                           check.status == rubato::ExitStatus::done;
  return as_expected ? 0 : 1;
}
