#include "report_command.hpp"

#include <cmath>
#include <filesystem>

#include <fmt/format.h>

#include <rubato/problem/document.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/report/comparison.hpp>
#include <rubato/report/csv.hpp>
#include <rubato/report/ensemble_page.hpp>
#include <rubato/report/page.hpp>
#include <rubato/report/xdmf.hpp>
#include <rubato/run/record_notes.hpp>

#include "beside.hpp"
#include "probe.hpp"
#include "terminal.hpp"

namespace rubato::program {

namespace {

constexpr const char* report_examples =
    "Examples:\n"
    "  rubato report mine.h5                      writes mine.html: open it in a browser, no network needed\n"
    "  rubato report mine.h5 -o seen.html --max-size 20\n"
    "  rubato report mine.h5 --full               every number of the record, however large the page\n";

constexpr const char* compare_examples =
    "Examples:\n"
    "  rubato compare variable.h5 fixed.h5        a table, and where the problems differ\n"
    "  rubato compare coarse.h5 fine.h5 -o both.html --max-size 10\n";

constexpr const char* export_examples =
    "Examples:\n"
    "  rubato export mine.h5                      CSV files in the folder mine-csv\n"
    "  rubato export mine.h5 -o tables\n"
    "  rubato export field.h5 --xdmf              field.xdmf, which ParaView opens\n";

std::string check_megabytes(const std::string& text) {
  double number = 0;
  return CLI::detail::lexical_cast(text, number) && std::isfinite(number) && number > 0 && number < 1e6
             ? ""
             : text + " is not a size in megabytes";
}

/// The same problem in the same words, however it was written.
std::string canonical(const std::string& problem) {
  return rubato::write_document(rubato::read_document(problem, "problem"));
}

/// What the problem in a record reports on its numbers; nothing, where that problem cannot be read or is not of these
/// states: the numbers can be drawn without.
report::Notes notes_on(const record::Reader& reader) {
  try {
    rubato::RecordNotes notes = rubato::notes_on(reader);
    return {std::move(notes.fields), std::move(notes.auxiliary), std::move(notes.rounding)};
  } catch (const std::logic_error&) {
    return {};
  } catch (const record::Error&) {
    return {};
  }
}

/// \throws std::invalid_argument if the page would be too small
report::PageOptions page_options(double megabytes, bool full) {
  return {.max_bytes = static_cast<std::size_t>(megabytes * 1e6), .full = full, .notes = notes_on};
}

}  // namespace

void ReportCommands::add_to(CLI::App& app) {
  add_report(app);
  add_compare(app);
  add_export(app);
}

void ReportCommands::add_report(CLI::App& app) {
  report_ = app.add_subcommand("report", "Draw a record as one page for a browser, which needs no network");
  report_->add_option("file", file_, "A record")->option_text("OUT.h5")->required();
  report_->add_option("-o,--output", output_, "The page to write (default: OUT.html)")->option_text("OUT.html");
  add_size(*report_);
  report_->add_option("--field", field_, "Of a plane or a volume, the field to draw at every node where there is room")
      ->option_text("NAME");
  report_->add_flag("-f,--force", force_, "Overwrite a file that is no report");
  report_->footer(report_examples);
}

void ReportCommands::add_size(CLI::App& command) {
  CLI::Option* const size =
      command.add_option("--max-size", max_size_, "The most that the page may have, in megabytes (5): thinned to fit")
          ->option_text("MB")
          ->check(check_megabytes);
  command.add_flag("--full", full_, "Thin nothing")->excludes(size);
}

void ReportCommands::add_compare(CLI::App& app) {
  compare_ = app.add_subcommand("compare", "Put two records side by side");
  compare_->add_option("first", file_, "A record")->option_text("A.h5")->required();
  compare_->add_option("second", other_file_, "Another one")->option_text("B.h5")->required();
  compare_->add_option("-o,--output", output_, "Write a page with the curves of both as well")->option_text("OUT.html");
  add_size(*compare_);
  compare_->add_flag("--json", json_, "Print one JSON object, and nothing else, on standard output");
  compare_->add_flag("-f,--force", force_, "Overwrite a file that is no report");
  compare_->footer(compare_examples);
}

void ReportCommands::add_export(CLI::App& app) {
  export_ = app.add_subcommand("export", "Write a record for other programs, as CSV or XDMF");
  export_->add_option("file", file_, "A record")->option_text("OUT.h5")->required();
  export_->add_option("-o,--output", output_, "The folder for the CSV files, or the XDMF file")->option_text("PATH");
  export_->add_flag("--xdmf", xdmf_, "An XDMF file that refers to the record, for ParaView");
  export_->add_flag("-f,--force", force_, "Overwrite existing files");
  export_->footer(export_examples);
}

std::optional<rubato::ExitStatus> ReportCommands::act() const {
  if (report_->parsed()) {
    report();
  } else if (compare_->parsed()) {
    compare();
  } else if (export_->parsed()) {
    export_record();
  } else {
    return std::nullopt;
  }
  return rubato::ExitStatus::done;
}

void ReportCommands::report() const {
  probe_record(file_);
  const record::Reader reader(file_);
  const std::string output = output_.value_or(beside(file_, ".html"));
  refuse_replacing(file_, output);
  report::PageOptions options = page_options(max_size_, full_);
  options.field = field_;
  const std::string page = report::page(reader, options);
  report::write_page(output, page, force_);
  print(fmt::format("{} ({:.1f} MB)\n", output, static_cast<double>(page.size()) / 1e6));
}

void ReportCommands::compare() const {
  probe_record(file_);
  probe_record(other_file_);
  const record::Reader first(file_), second(other_file_);
  if (report::is_ensemble(first) || report::is_ensemble(second)) {
    const report::EnsembleComparison comparison = report::compare_ensembles(first, second, canonical);
    if (output_) {
      throw std::invalid_argument(
          "-o: no page shows two ensembles; leave it out, and have `rubato report` draw each by itself");
    }
    print(json_ ? report::to_json(comparison) + "\n" : report::to_table(comparison));
    return;
  }
  const report::Comparison comparison = report::compare(first, second, canonical);
  if (output_) {
    refuse_replacing(file_, *output_);
    refuse_replacing(other_file_, *output_);
    report::write_page(*output_, report::comparison_page(first, second, page_options(max_size_, full_), canonical),
                       force_);
  }
  print(json_ ? report::to_json(comparison) + "\n" : report::to_table(comparison));
  if (output_ && !json_) {
    print(*output_ + "\n");
  }
}

void ReportCommands::export_record() const {
  probe_record(file_);
  const record::Reader reader(file_);
  if (xdmf_) {
    const std::string output = output_.value_or(beside(file_, ".xdmf"));
    refuse_replacing(file_, output);
    report::export_xdmf(reader, output, force_);
    print(output + "\n");
    return;
  }
  for (const std::filesystem::path& file :
       report::export_csv(reader, output_.value_or(beside(file_, "-csv")), force_)) {
    print(file.string() + "\n");
  }
}

}  // namespace rubato::program
