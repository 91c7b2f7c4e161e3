#include <rubato/report/ensemble_page.hpp>

#include <algorithm>
#include <array>
#include <limits>
#include <map>

#include <fmt/format.h>

#include <rubato/figures/members.hpp>
#include <rubato/report/page_data.hpp>

namespace rubato::report {

namespace {

constexpr std::string_view members_group = "/members/", given_group = "/members/values/", last_group = "/members/last/";
constexpr std::string_view members_axis = "/members/number";
/// Coordinates and momenta of more degrees of freedom are left to the record.
constexpr std::size_t most_degrees = 8;

bool has_one_number(const record::DatasetInfo& info) {
  return info.grows && !info.is_text && info.shape.size() == 1;
}

/// One column of the rows of a dataset. \throws record::Error where there are not so many
std::vector<double> read_one(const record::Reader& reader, const std::string& path, std::size_t rows,
                             std::size_t offset) {
  if (rows == 0) {
    return {};
  }
  const std::vector<double> all = read_rows(reader, path, rows, offset);
  const std::size_t stride = all.size() / rows;
  std::vector<double> column(rows);
  for (std::size_t i = 0; i < rows; ++i) {
    column[i] = all[i * stride + offset];
  }
  return column;
}

}  // namespace

std::vector<MemberColumn> member_columns(const record::Reader& reader) {
  std::vector<MemberColumn> given, figures, last;
  for (const record::DatasetInfo& info : reader.datasets()) {
    if (!info.path.starts_with(members_group) || info.path.ends_with("/number")) {
      continue;
    }
    if (info.path.starts_with(given_group) && has_one_number(info)) {
      const std::string name = info.path.substr(given_group.size());
      given.push_back({name, "given", name, info.path});
    } else if (info.path.starts_with(last_group)) {
      const std::string part = info.path.substr(last_group.size());
      if ((part == "q" || part == "p") && info.shape.size() == 2 && info.shape[1] <= most_degrees) {
        const auto names = reader.read_strings(part == "q" ? "/states/coordinate" : "/states/momentum");
        for (std::size_t i = 0; i < std::min(names.size(), info.shape[1]); ++i) {
          last.push_back({names[i], "last", names[i] + " at the end", info.path, i});
        }
      }
    } else if (has_one_number(info)) {
      const std::string name = info.path.substr(members_group.size());
      const std::string label = name == "status" ? "exit status" : figures::label_of_figure(name);
      if (!label.empty()) {
        figures.push_back({name, "figure", label, info.path});
      }
    }
  }
  std::ranges::stable_sort(figures, {},
                           [](const MemberColumn& figure) { return figures::rank_of_figure(figure.name); });
  for (const auto* more : {&figures, &last}) {
    given.insert(given.end(), more->begin(), more->end());
  }
  return given;
}

std::vector<double> read_column(const record::Reader& reader, const MemberColumn& column) {
  return read_one(reader, column.path, reader.rows(std::string(members_axis)), column.offset);
}

namespace {

std::size_t stride_for(std::size_t rows, std::size_t most) {
  return rows == 0 ? 1 : (rows - 1) / std::max<std::size_t>(most, 1) + 1;
}

std::vector<double> every(const std::vector<double>& values, std::size_t stride) {
  std::vector<double> picked;
  for (std::size_t i = 0; i < values.size(); i += stride) {
    picked.push_back(values[i]);
  }
  return picked;
}

/// The words that a column of places among words stands for, as its description has them.
std::vector<std::string> words_of(const std::string& description) {
  constexpr std::string_view before = "the place, from 0, among ";
  const std::size_t at = description.find(before);
  std::vector<std::string> words;
  for (std::size_t begin = at == std::string::npos ? description.size() : at + before.size();
       begin < description.size();) {
    const std::size_t end = std::min(description.find(", ", begin), description.size());
    words.push_back(description.substr(begin, end - begin));
    begin = end + 2;
  }
  return words;
}

/// Which event ended each run, by its place in `names`; not a number where none did. Nothing without such events.
std::vector<double> ended_by(const record::Reader& reader, std::vector<std::string>& names) {
  constexpr std::string_view group = "/members/events/", suffix = "/last";
  if (!reader.has("/members/stopped/t")) {
    return {};
  }
  const std::size_t count = reader.rows(std::string(members_axis));
  const std::vector<double> stopped = read_one(reader, "/members/stopped/t", count, 0);
  std::vector<double> by(count, std::numeric_limits<double>::quiet_NaN());
  for (const record::DatasetInfo& info : reader.datasets()) {
    if (!info.path.starts_with(group) || !info.path.ends_with(suffix)) {
      continue;
    }
    const std::vector<double> last = read_one(reader, info.path, count, 0);
    bool any = false;
    for (std::size_t m = 0; m < count; ++m) {
      if (last[m] == stopped[m]) {
        by[m] = static_cast<double>(names.size());
        any = true;
      }
    }
    if (any) {
      names.push_back(info.path.substr(group.size(), info.path.size() - group.size() - suffix.size()));
    }
  }
  return names.size() > 1 ? by : std::vector<double>();
}

void write_members(Json& json, const record::Reader& reader, std::size_t most_rows) {
  const std::size_t count = reader.rows(std::string(members_axis));
  const std::size_t stride = stride_for(count, most_rows);
  json.key("members").begin_object().entry("count", count).entry("stride", stride).key("columns").begin_array();
  const auto write = [&](const MemberColumn& column, const std::vector<std::string>& words,
                         const std::vector<double>& values) {
    json.begin_object().entry("name", column.name).entry("group", column.group).entry("label", column.label);
    json.key("words").begin_array();
    for (const std::string& word : words) {
      json.value(word);
    }
    json.end_array().key("values");
    write_f32(json, every(values, stride));
    json.end_object();
  };
  std::vector<std::string> events;
  if (const std::vector<double> by = ended_by(reader, events); !by.empty()) {
    write({"ended_by", "figure", "ended by the event", ""}, events, by);
  }
  for (const MemberColumn& column : member_columns(reader)) {
    write(column, words_of(reader.info(column.path).description), read_column(reader, column));
  }
  json.end_array().end_object();
}

bool has_paths(const record::Reader& reader) {
  return reader.has("/output/q") && reader.has("/output/p") && reader.has("/output/member") &&
         reader.info("/output/q").row_size() <= most_degrees;
}

/// Orbits at the output times, of so many members as there is room for, evenly among them.
void write_paths(Json& json, const record::Reader& reader, std::size_t most_rows) {
  json.key("paths").begin_array();
  if (!has_paths(reader)) {
    json.end_array();
    return;
  }
  const std::size_t rows = reader.rows("/output/t");
  const std::vector<double> member = read_one(reader, "/output/member", rows, 0);
  std::size_t members = 0;
  for (std::size_t i = 0; i < rows; ++i) {
    members += i == 0 || member[i] != member[i - 1] ? 1 : 0;
  }
  const std::size_t per_member = rows / std::max<std::size_t>(members, 1) + 1;
  const std::size_t stride = stride_for(members, std::max<std::size_t>(most_rows / per_member, 1));
  std::vector<std::size_t> picked;
  std::size_t number = 0;
  for (std::size_t i = 0; i < rows; ++i) {
    number += i > 0 && member[i] != member[i - 1] ? 1 : 0;
    if (number % stride == 0 && picked.size() < most_rows) {
      picked.push_back(i);
    }
  }
  const auto write = [&](const std::string& name, const std::string& path, std::size_t offset) {
    const std::vector<double> all = read_one(reader, path, rows, offset);
    std::vector<double> values;
    for (const std::size_t i : picked) {
      values.push_back(all[i]);
    }
    json.begin_object().entry("name", name).key("values");
    write_f32(json, values);
    json.end_object();
  };
  write("member", "/output/member", 0);
  for (const auto& [names, path] :
       {std::pair("/states/coordinate", "/output/q"), std::pair("/states/momentum", "/output/p")}) {
    const std::vector<std::string> list = reader.read_strings(names);
    for (std::size_t i = 0; i < std::min(list.size(), reader.info(path).row_size()); ++i) {
      write(list[i], path, i);
    }
  }
  json.end_array().key("path_members").begin_object().entry("count", members);
  json.entry("shown", (members + stride - 1) / stride).end_object();
}

/// Events with two quantities or more.
std::vector<std::string> ensemble_sections(const record::Reader& reader) {
  constexpr std::string_view group = "/events/", suffix = "/quantities";
  std::vector<std::string> names;
  for (const record::DatasetInfo& info : reader.datasets()) {
    if (info.path.starts_with(group) && info.path.ends_with(suffix) && info.grows && info.row_size() > 1) {
      names.push_back(info.path.substr(group.size(), info.path.size() - group.size() - suffix.size()));
    }
  }
  return names;
}

void write_ensemble_sections(Json& json, const record::Reader& reader, std::size_t most_rows) {
  json.key("sections").begin_array();
  for (const std::string& name : ensemble_sections(reader)) {
    const std::string group = "/events/" + name;
    const std::size_t rows = reader.rows(group + "/t"), stride = stride_for(rows, most_rows);
    const std::vector<std::string> quantities = reader.read_strings(group + "/quantity");
    json.begin_object().entry("name", name).entry("count", rows).key("columns").begin_array();
    for (std::size_t i = 0; i < quantities.size(); ++i) {
      json.begin_object().entry("name", quantities[i]).key("values");
      write_f32(json, every(read_one(reader, group + "/quantities", rows, i), stride));
      json.end_object();
    }
    json.end_array().key("member");
    write_f32(json, every(read_one(reader, group + "/member", rows, 0), stride));
    json.end_object();
  }
  json.end_array();
}

}  // namespace

bool is_ensemble(const record::Reader& reader) {
  return reader.has(std::string(members_axis));
}

/// The exit status of a run that reached its end with the verdict "lost".
constexpr int lost_status = 7;

void write_ensemble_summary(Json& json, const record::Reader& reader) {
  json.key("summary").begin_array();
  const auto line = [&json](const figures::Line& of) {
    json.begin_array().value(of.label).value(of.value).value(of.remark).value(of.is_headline).end_array();
  };
  const std::size_t count = reader.rows(std::string(members_axis));
  std::map<int, std::size_t> ended;
  for (const double status : read_one(reader, "/members/status", count, 0)) {
    ++ended[static_cast<int>(status)];
  }
  line({"members", fmt::format("{}", count), "", true});
  for (const auto& [status, members] : ended) {
    if (status != 0 && status != lost_status) {
      line({"ended early", fmt::format("{}", members), fmt::format("with exit status {}", status), true});
    }
  }
  if (const std::string path = "/members/verdict"; reader.has(path)) {
    std::array<std::size_t, 3> verdicts{};
    for (const double verdict : read_one(reader, path, count, 0)) {
      ++verdicts.at(static_cast<std::size_t>(std::clamp(verdict, 0.0, 2.0)));
    }
    line({"verdict", fmt::format("{} good, {} doubtful, {} lost", verdicts[0], verdicts[1], verdicts[2]),
          "by the measures of each member", true});
  }
  for (const MemberColumn& column : member_columns(reader)) {
    if (column.group != "figure" || column.name == "status") {
      continue;
    }
    if (const auto values = figures::distribution_of(read_column(reader, column)); values.any()) {
      line(figures::line_of(column.label, values));
    }
  }
  json.end_array();
}

void write_ensemble(Json& json, const record::Reader& reader, std::size_t most_rows) {
  write_members(json, reader, most_rows);
  write_paths(json, reader, most_rows);
  write_ensemble_sections(json, reader, most_rows);
}

std::size_t count_ensemble_columns(const record::Reader& reader) {
  std::size_t columns = member_columns(reader).size() + 1;  // and which event ended the run
  if (has_paths(reader)) {
    columns += 1 + reader.info("/output/q").row_size() + reader.info("/output/p").row_size();
  }
  for (const std::string& name : ensemble_sections(reader)) {
    columns += 1 + reader.read_strings("/events/" + name + "/quantity").size();
  }
  return columns;
}

}  // namespace rubato::report
