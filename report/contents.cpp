#include <rubato/report/contents.hpp>

#include <optional>
#include <string_view>
#include <utility>

#include <rubato/record/run_shape.hpp>

namespace rubato::report {

namespace {

/// The rest of a path directly inside a group.
std::optional<std::string> name_in(std::string_view group, std::string_view path) {
  if (!path.starts_with(group) || path.find('/', group.size()) != std::string_view::npos) {
    return std::nullopt;
  }
  return std::string(path.substr(group.size()));
}

bool lies_along(const record::DatasetInfo& info, std::string_view axis) {
  return info.grows && !info.dimensions.empty() && info.dimensions.front() == axis && !info.path.ends_with("/t") &&
         !info.path.ends_with("/level");
}

}  // namespace

Contents contents_of(const record::Reader& reader) {
  record::require_run(reader);
  Contents contents;
  constexpr std::string_view suffix = "_max";
  for (const record::DatasetInfo& info : reader.datasets()) {
    const bool is_field = info.shape.size() > 1;
    if (const auto midpoint = name_in("/states/midpoints/", info.path); midpoint && is_field) {
      contents.fields.push_back({*midpoint, info.path, true});
    } else if (const auto state = name_in("/states/", info.path);
               state && is_field && info.dimensions[1] != "coordinate" && info.dimensions[1] != "momentum" &&
               info.dimensions[1] != "velocity") {
      contents.fields.push_back({*state, info.path, false});
      contents.axes.assign(info.dimensions.begin() + 1, info.dimensions.end());
    } else if (const auto exact = name_in("/exact/", info.path); exact && lies_along(info, "t")) {
      contents.exact.push_back(*exact);
    } else if (const auto quantity = name_in("/output/quantities/", info.path); quantity && lies_along(info, "t")) {
      if (is_field) {
        contents.node_quantities.push_back({*quantity, info.path, false});
      } else {
        contents.quantities.push_back(*quantity);
      }
    } else if (const auto event = name_in("/events/", info.path.substr(0, info.path.rfind('/'))); event && info.grows) {
      if (info.path.ends_with("/t")) {
        contents.events.push_back(*event);
      } else if (info.path.ends_with("/quantities") && info.row_size() > 1) {
        contents.sections.push_back(*event);
      }
    } else if (const auto total = name_in("/laws/totals/", info.path); total && lies_along(info, "t")) {
      contents.totals.push_back(*total);
    } else if (const auto constraint = name_in("/laws/constraints/", info.path);
               constraint && info.grows && constraint->ends_with(suffix)) {
      contents.residuals.push_back("constraints/" + constraint->substr(0, constraint->size() - suffix.size()));
    } else if (const auto residual = name_in("/laws/fields/", info.path); residual && is_field) {
      contents.residual_fields.push_back(*residual);
    } else if (const auto law = name_in("/laws/", info.path); law && lies_along(info, "t")) {
      contents.invariants.push_back(*law);
    } else if (law && info.grows && law->ends_with(suffix) && !info.is_text) {
      contents.residuals.push_back(law->substr(0, law->size() - suffix.size()));
    }
  }
  contents.kind = contents.fields.empty() ? Contents::Kind::orbit : Contents::Kind::lattice;
  if (contents.kind == Contents::Kind::orbit) {
    contents.coordinates = reader.read_strings("/states/coordinate");
    contents.momenta = reader.read_strings("/states/momentum");
    if (reader.has("/states/velocity")) {
      contents.velocities = reader.read_strings("/states/velocity");
    }
  }
  return contents;
}

Contents with_quantities_as_fields(Contents contents) {
  contents.fields = std::move(contents.node_quantities);
  contents.node_quantities.clear();
  contents.field_group = "quantity";
  contents.field_times = "/output/t";
  contents.exact.clear();
  contents.residual_fields.clear();
  return contents;
}

figures::Statistics summarise(const record::Reader& reader, const Contents& contents) {
  return figures::stored_statistics(reader, {.invariants = contents.invariants,
                                             .totals = contents.totals,
                                             .residuals = contents.residuals,
                                             .exact = contents.exact,
                                             .events = contents.events});
}

}  // namespace rubato::report
