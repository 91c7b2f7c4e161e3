// Two ensembles side by side: the table of each, and member by member where they were given the same.

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/figures/members.hpp>
#include <rubato/report/comparison.hpp>
#include <rubato/report/ensemble_page.hpp>

namespace rubato::report {

namespace {

using Columns = std::vector<MemberColumn>;

const MemberColumn* find_column(const Columns& columns, const MemberColumn& like) {
  const auto found = std::ranges::find_if(
      columns, [&](const MemberColumn& column) { return column.path == like.path && column.name == like.name; });
  return found == columns.end() ? nullptr : &*found;
}

bool same_or_none(double a, double b) {
  return a == b || (std::isnan(a) && std::isnan(b));
}

/// Which members with the same number were given the same. Words are given by their places in a list: those of another
/// list are others.
std::vector<std::size_t> alike(const record::Reader& a, const record::Reader& b, const Columns& in_a,
                               const Columns& in_b) {
  const auto is_given = [](const MemberColumn& column) { return column.group == "given"; };
  if (std::ranges::count_if(in_a, is_given) != std::ranges::count_if(in_b, is_given)) {
    return {};
  }
  const std::size_t count = std::min(a.rows("/members/number"), b.rows("/members/number"));
  std::vector<bool> same(count, true);
  for (const MemberColumn& column : in_a) {
    if (!is_given(column)) {
      continue;
    }
    const MemberColumn* const other = find_column(in_b, column);
    if (other == nullptr || a.info(column.path).description != b.info(other->path).description) {
      return {};
    }
    const std::vector<double> left = read_column(a, column), right = read_column(b, *other);
    for (std::size_t m = 0; m < count; ++m) {
      same[m] = same[m] && left[m] == right[m];
    }
  }
  std::vector<std::size_t> numbers;
  for (std::size_t m = 0; m < count; ++m) {
    if (same[m]) {
      numbers.push_back(m);
    }
  }
  return numbers;
}

void compare_members(const std::vector<double>& a, const std::vector<double>& b,
                     const std::vector<std::size_t>& numbers, EnsembleComparison::Column& into) {
  for (const std::size_t m : numbers) {
    if (same_or_none(a[m], b[m])) {
      ++into.same;
      continue;
    }
    const double distance = std::abs(a[m] - b[m]);
    const double apart = std::isnan(distance) ? std::numeric_limits<double>::infinity() : distance;
    if (apart > into.farthest) {
      into.farthest = apart;
      into.member = m;
      into.there = {a[m], b[m]};
    }
  }
}

std::string number_or_none(double value) {
  return std::isnan(value) ? "none" : fmt::format("{:.10g}", value);
}

std::string given_entries(const record::Reader& reader, const Columns& columns) {
  std::vector<std::string> names;
  for (const MemberColumn& column : columns) {
    if (column.group == "given") {
      names.push_back(column.name);
    }
  }
  return fmt::format("{} members, of {}", reader.rows("/members/number"), fmt::join(names, ", "));
}

}  // namespace

EnsembleComparison compare_ensembles(const record::Reader& a, const record::Reader& b, const Canonical& canonical) {
  if (!is_ensemble(a) || !is_ensemble(b)) {
    const auto kind = [](const record::Reader& reader) { return is_ensemble(reader) ? "an ensemble" : "one run"; };
    throw std::invalid_argument(fmt::format(
        "nothing can be compared: {} is the record of {}, {} that of {}; run one member alone to put it beside a run",
        a.file().string(), kind(a), b.file().string(), kind(b)));
  }
  const Columns in_a = member_columns(a), in_b = member_columns(b);
  EnsembleComparison comparison{.files = {a.file().string(), b.file().string()},
                                .titles = {a.header().title, b.header().title},
                                .members = {a.rows("/members/number"), b.rows("/members/number")},
                                .ended_early = {},
                                .columns = {},
                                .only_in = {}};
  const std::vector<std::size_t> numbers = alike(a, b, in_a, in_b);
  comparison.alike = numbers.size();
  for (const MemberColumn& column : in_a) {
    const MemberColumn* const other = find_column(in_b, column);
    if (column.group == "given" || other == nullptr) {
      continue;
    }
    const std::vector<double> left = read_column(a, column), right = read_column(b, *other);
    if (column.name == "status") {
      const auto ended = [](const std::vector<double>& status) {
        return static_cast<std::size_t>(std::ranges::count_if(status, [](double value) {
          constexpr double done = 0.0, lost = 7.0;  // exit statuses of runs that reached their end
          return value != done && value != lost;
        }));
      };
      comparison.ended_early = {ended(left), ended(right)};
    }
    EnsembleComparison::Column reported{.name = column.name,
                                        .label = column.label,
                                        .values = {figures::distribution_of(left), figures::distribution_of(right)}};
    if (reported.values[0].any() || reported.values[1].any()) {
      compare_members(left, right, numbers, reported);
      comparison.columns.push_back(std::move(reported));
    }
  }
  const bool has_last_states = [&] {
    const auto is_last = [](const MemberColumn& column) { return column.group == "last"; };
    const bool in_first = std::ranges::any_of(in_a, is_last), in_second = std::ranges::any_of(in_b, is_last);
    return !in_first || !in_second || std::ranges::any_of(comparison.columns, [&](const auto& column) {
      return std::ranges::any_of(in_a, [&](const MemberColumn& of) { return is_last(of) && of.name == column.name; });
    });
  }();
  if (!has_last_states) {
    throw std::invalid_argument(fmt::format("nothing can be compared: {} has {}, {} has {}, of other coordinates",
                                            a.file().string(), given_entries(a, in_a), b.file().string(),
                                            given_entries(b, in_b)));
  }
  comparison.only_in = problem_differences(a, b, canonical);
  return comparison;
}

std::string to_table(const EnsembleComparison& comparison) {
  const auto count = [](std::size_t number) { return number == 0 ? std::string("none") : fmt::format("{}", number); };
  std::vector<std::array<std::string, 3>> lines = {
      {"members", count(comparison.members[0]), count(comparison.members[1])},
      {"ended early", count(comparison.ended_early[0]), count(comparison.ended_early[1])}};
  for (const EnsembleComparison::Column& column : comparison.columns) {
    if (column.name != "status") {
      const auto reported = [&](std::size_t i) {
        return column.values[i].any() ? figures::line_of(column.label, column.values[i]).value : "";
      };
      lines.push_back({column.label, reported(0), reported(1)});
    }
  }
  std::string text = table_side_by_side(comparison.titles, comparison.files, lines);
  if (comparison.alike == 0) {
    text += "no member was given the same in both: they are not compared one by one\n";
  } else {
    text += fmt::format("member by member, {} given the same in both:\n", comparison.alike);
    for (const EnsembleComparison::Column& column : comparison.columns) {
      const std::string apart = fmt::format("farthest apart in member {}: {} and {}", column.member,
                                            number_or_none(column.there[0]), number_or_none(column.there[1]));
      text += fmt::format("  {:<38} {}\n", column.label,
                          column.same == comparison.alike ? "the same in all"
                          : column.same == 0              ? apart
                                                          : fmt::format("the same in {}; {}", column.same, apart));
    }
  }
  return text + told_differences(comparison.files, comparison.only_in);
}

std::string to_json(const EnsembleComparison& comparison) {
  std::vector<figures::JsonObject> records(2), reported;
  for (const std::size_t i : {0, 1}) {
    records[i]
        .text("file", comparison.files[i])
        .count("members", comparison.members[i])
        .count("ended_early", comparison.ended_early[i]);
  }
  for (const EnsembleComparison::Column& column : comparison.columns) {
    std::vector<figures::JsonObject> of(2), there(2);
    for (const std::size_t i : {0, 1}) {
      const figures::Distribution& values = column.values[i];
      if (values.any()) {
        of[i]
            .number("min", values.min)
            .number("max", values.max)
            .number("mean", values.mean)
            .count("worst", values.worst);
      }
      there[i].number("value", column.there[i]);
    }
    figures::JsonObject figure;
    figure.text("name", column.name).objects("records", of).count("same", column.same);
    if (column.same < comparison.alike) {
      figure.number("farthest", column.farthest).count("member", column.member).objects("there", there);
    }
    reported.push_back(std::move(figure));
  }
  return figures::JsonObject()
      .objects("records", records)
      .count("members_alike", comparison.alike)
      .objects("figures", reported)
      .lists("problem_differences", {comparison.only_in[0], comparison.only_in[1]})
      .str();
}

}  // namespace rubato::report
