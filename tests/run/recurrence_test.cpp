// The recurrence of Fermi, Pasta, Ulam and Tsingou: when the energy is back in the mode that it started in.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <string>
#include <vector>

#include <rubato/record/reader.hpp>

#include "run/records.hpp"

using namespace rubato;
using namespace rubato;
using namespace rubato::run_tests;

namespace {

struct Recurrence {
  double t = 0.0, share = 0.0;  ///< of the energy that the first mode began with
  double least = 0.0;           ///< the share that it had in between
};

Recurrence recurrence(const std::vector<std::string>& settings) {
  const Folder folder;
  const std::string file = folder / "chain.h5";
  REQUIRE(run_problem("fput-recurrence", file, settings).status == ExitStatus::done);
  const record::Reader reader(file);
  const std::vector<double> t = reader.read("/output/t"), first = reader.read("/output/quantities/first");
  const auto half = std::ranges::lower_bound(t, 2500.0) - t.begin();
  const auto away = std::min_element(first.begin(), first.begin() + half);
  const auto back = std::max_element(away, first.end());
  return {.t = t[back - first.begin()], .share = *back / first.front(), .least = *away / first.front()};
}

}  // namespace

TEST_CASE("the chain of 32 masses with beta = 8 has its recurrence at 4935.8", "[run]") {
  const Recurrence found = recurrence({});
  CHECK(std::abs(found.t - 4935.8) < 1.0);
  CHECK(found.share > 0.99);
  CHECK(found.least < 0.06);
  // Half the step changes nothing that the times of output could show.
  CHECK(std::abs(recurrence({"scheme.step=0.05"}).t - found.t) < 0.11);
  // The twins: another force, another chain, and a scheme whose laws hold and whose orbit is wrong.
  CHECK(std::abs(recurrence({"parameters.beta=7.9"}).t - 4935.8) > 1.0);
  CHECK(std::abs(recurrence({"parameters.N=31"}).t - 4935.8) > 1.0);
  CHECK(std::abs(recurrence({"scheme.order=2", "scheme.step=0.2"}).t - 4935.8) > 1.0);
}
