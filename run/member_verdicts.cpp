#include <rubato/run/member_verdicts.hpp>

#include <algorithm>
#include <cctype>
#include <charconv>

#include <fmt/format.h>

namespace rubato {

namespace {

using figures::Verdict;

bool is_digit(char c) {
  return std::isdigit(static_cast<unsigned char>(c)) != 0;
}

/// The sentence with # for each number.
std::string without_numbers(std::string_view sentence) {
  constexpr std::string_view inside = "0123456789.eE+-";
  std::string kind;
  for (std::size_t i = 0; i < sentence.size();) {
    if (!is_digit(sentence[i])) {
      kind += sentence[i++];
      continue;
    }
    const std::size_t end = std::min(sentence.find_first_not_of(inside, i), sentence.size());
    kind += '#';
    i = end;
  }
  return kind;
}

constexpr char between = '\t', ending = '\n';

std::string line_of(std::initializer_list<std::string> parts) {
  std::string line;
  for (std::string part : parts) {
    std::ranges::replace_if(
        part, [](char c) { return c == between || c == ending; }, ' ');
    line += part + between;
  }
  line.back() = ending;
  return line;
}

std::vector<std::string> parts_of(std::string_view text, char separator) {
  std::vector<std::string> parts;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find(separator), text.size());
    parts.emplace_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return parts;
}

template <typename Number>
Number number_of(const std::string& text) {
  Number number{};
  std::from_chars(text.data(), text.data() + text.size(), number);
  return number;
}

}  // namespace

void MemberVerdicts::add(std::size_t number, const std::string& label, const std::vector<std::string>& warnings,
                         const figures::Judgement& judgement, RunEnd end) {
  const std::string which = label.empty() ? fmt::format("{}", number) : label;
  std::vector<std::string> seen;  // a run counts once
  for (const std::string& sentence : warnings) {
    std::string kind = without_numbers(sentence);
    if (std::ranges::find(seen, kind) != seen.end()) {
      continue;
    }
    seen.push_back(std::move(kind));
    add_warning(which, sentence);
  }
  for (const figures::Reason& reason : judgement.reasons) {
    add_reason(which, reason);
  }
  add_verdict(judgement.verdict, end);
}

void MemberVerdicts::add_reason(const std::string& which, const figures::Reason& reason) {
  const auto found = std::ranges::find_if(causes_, [&](const Cause& cause) { return cause.worst.kind == reason.kind; });
  if (found == causes_.end()) {
    causes_.push_back({.worst = reason, .members = 1, .which = which});
    return;
  }
  ++found->members;
  if (reason.verdict > found->worst.verdict) {
    found->worst = reason;
    found->which = which;
  }
}

void MemberVerdicts::doubt(const std::string& which, const figures::Reason& reason, Verdict before) {
  add_reason(which, reason);
  --verdicts_[static_cast<std::size_t>(before)];
  ++verdicts_[static_cast<std::size_t>(std::max(before, reason.verdict))];
}

void MemberVerdicts::add_warning(const std::string& which, const std::string& sentence) {
  std::string kind = without_numbers(sentence);
  const auto found = std::ranges::find(warnings_, kind, &Warning::kind);
  if (found == warnings_.end()) {
    warnings_.push_back({.kind = std::move(kind), .members = 1, .first = which, .sentence = sentence});
  } else {
    ++found->members;
  }
}

void MemberVerdicts::add_verdict(Verdict verdict, RunEnd end) {
  ++runs_;
  if (end == RunEnd::interrupted) {
    return;
  }
  ++verdicts_[static_cast<std::size_t>(verdict)];
  if (end == RunEnd::complete) {
    ++complete_;
    complete_lost_ += verdict == Verdict::lost ? 1 : 0;
  }
}

Verdict MemberVerdicts::verdict() const {
  const auto worst = std::ranges::find_if(verdicts_.rbegin(), verdicts_.rend(), [](std::size_t n) { return n > 0; });
  return worst == verdicts_.rend() ? Verdict::good : static_cast<Verdict>(verdicts_.rend() - worst - 1);
}

bool MemberVerdicts::all_lost() const {
  return complete_ > 0 && complete_lost_ == complete_;
}

std::vector<std::string> MemberVerdicts::warnings(std::string_view plural) const {
  std::vector<std::string> sentences;
  for (const Warning& warning : warnings_) {
    sentences.push_back(fmt::format("in {} of {} {}, the first: {}: {}", warning.members, runs_, plural, warning.first,
                                    warning.sentence));
  }
  return sentences;
}

std::string MemberVerdicts::verdict_text(std::string_view plural) const {
  if (runs_ == 0) {
    return fmt::format("none: none of the {} has ended", plural);
  }
  std::string text = fmt::format("{} (of {} {}: {} good, {} doubtful, {} lost)", figures::to_string(verdict()), runs_,
                                 plural, verdicts_[0], verdicts_[1], verdicts_[2]);
  for (const Cause& cause : causes_) {
    text += fmt::format("{}in {} of {} {}, the worst: {}: {}; {}", &cause == causes_.data() ? ": " : ". ",
                        cause.members, runs_, plural, cause.which, cause.worst.finding, cause.worst.remedy);
  }
  return text;
}

void MemberVerdicts::add_to(figures::JsonObject& object, std::string_view plural) const {
  object.text("verdict", runs_ == 0 ? "none" : figures::to_string(verdict()));
  figures::JsonObject counts;
  counts.count("good", verdicts_[0]).count("doubtful", verdicts_[1]).count("lost", verdicts_[2]);
  object.object("verdicts", counts);
  std::vector<figures::JsonObject> reasons;
  for (const Cause& cause : causes_) {
    reasons.push_back(figures::json(cause.worst));
    reasons.back().count("members", cause.members).text("worst", cause.which);
  }
  object.objects("reasons", reasons).texts("warnings", warnings(plural));
}

std::string MemberVerdicts::saved() const {
  std::string text;
  for (const Warning& warning : warnings_) {
    text += line_of({"warning", fmt::format("{}", warning.members), warning.first, warning.sentence});
  }
  for (const Cause& cause : causes_) {
    text += line_of({"reason", fmt::format("{}", cause.members), cause.which,
                     fmt::format("{}", static_cast<int>(cause.worst.kind)),
                     fmt::format("{}", static_cast<int>(cause.worst.verdict)), fmt::format("{}", cause.worst.value),
                     cause.worst.finding, cause.worst.remedy});
  }
  return text;
}

void MemberVerdicts::restore(std::string_view text) {
  for (const std::string& line : parts_of(text, ending)) {
    const std::vector<std::string> parts = parts_of(line, between);
    if (parts.size() == 4 && parts[0] == "warning") {
      warnings_.push_back({.kind = without_numbers(parts[3]),
                           .members = number_of<std::size_t>(parts[1]),
                           .first = parts[2],
                           .sentence = parts[3]});
    } else if (parts.size() == 8 && parts[0] == "reason") {
      causes_.push_back({.worst = {.kind = static_cast<figures::ReasonKind>(number_of<int>(parts[3])),
                                   .verdict = static_cast<Verdict>(number_of<int>(parts[4])),
                                   .value = number_of<double>(parts[5]),
                                   .finding = parts[6],
                                   .remedy = parts[7]},
                         .members = number_of<std::size_t>(parts[1]),
                         .which = parts[2]});
    }
  }
}

}  // namespace rubato
