#include <rubato/run/law.hpp>

namespace rubato {

void Law::describe(record::Layout& layout, bool gaps) {
  using record::Type;
  const std::string remark = gaps ? " of the step (undefined where it has none, or was not taken)"
                                  : " of the step (undefined where it has none)";
  max_ = layout.add({max_path(), "/levels/step", {}, Type::f64, "largest local residual" + remark, true});
  rms_ =
      layout.add({rms_path(), "/levels/step", {}, Type::f64, "root mean square of the local residuals" + remark, true});
  undefined_ = layout.add({undefined_path(),
                           "/levels/step",
                           {},
                           Type::i32,
                           "number of cells in which the local residual of the step is not defined"});
}

void Law::describe_cells(record::Layout& layout, const std::vector<std::string>& dimensions, bool gaps) {
  cells_column_ =
      layout.add({cells_path(), "/states/t", dimensions, record::Type::f64,
                  "local residual of " + name_ + " over the step that led to the stored level; undefined at the start" +
                      (gaps ? " and where it was not taken" : ""),
                  true});
}

void Law::append(RowSink& sink) const {
  const figures::ResidualFigures& reported = figures();
  sink.append(max_, reported.max);
  sink.append(rms_, reported.rms);
  sink.append(undefined_, static_cast<std::int64_t>(reported.undefined));
}

}  // namespace rubato
