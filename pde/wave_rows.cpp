#include <rubato/pde/wave_rows.hpp>

#include <algorithm>

#include <rubato/grids/grid.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/grids/transposition.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/tuning.hpp>

namespace rubato {

double largest_of_rows(std::span<const double> values) {
  const grids::Slab::Shared alone(nullptr);
  return grids::max_abs(values);
}

int transformed_at_once(const grids::Grid& grid, int fields) {
  return grid.size() > tuning::wave_rows::nodes_of_one_transform ? 1 : fields;
}

void from_grid(std::span<const double* const> fields, grids::Fourier& fourier, WaveRows& rows) {
  const std::size_t length = std::max<std::size_t>(1, fourier.row_length());  // a rank may have no waves
  const std::size_t lines = rows.waves() / length, most = static_cast<std::size_t>(fourier.fields());
  for (std::size_t done = 0, count = 0; done < fields.size(); done += count) {
    const auto left = fields.subspan(done);
    if (left.front() == nullptr) {
      count = 1;
      continue;
    }
    count = std::min(most, static_cast<std::size_t>(std::ranges::find(left, nullptr) - left.begin()));
    const auto some = left.first(count);
    fourier.forward(some);
    grids::for_each_block(some.size() * lines, std::max<std::size_t>(1, grids::nodes_per_block / length),
                          [&](std::size_t begin, std::size_t end) {
                            for (std::size_t unit = begin; unit < end; ++unit) {
                              const std::size_t f = lines == 1 ? unit : unit / lines,
                                                first = lines == 1 ? 0 : unit % lines * length;
                              const auto row = static_cast<int>(done + f);
                              separate(reinterpret_cast<const double*>(&fourier.at(static_cast<int>(f), first)), length,
                                       rows.re.field(row).data() + first, rows.im.field(row).data() + first);
                            }
                          });
  }
}

void to_grid(const WaveRows& rows, std::span<const int> which, grids::Fourier& fourier,
             std::span<double* const> fields) {
  const std::size_t length = std::max<std::size_t>(1, fourier.row_length());  // a rank may have no waves
  const std::size_t lines = rows.waves() / length, most = static_cast<std::size_t>(fourier.fields());
  for (std::size_t done = 0; done < which.size(); done += most) {
    const std::size_t count = std::min(most, which.size() - done);
    grids::for_each_block(count * lines, std::max<std::size_t>(1, grids::nodes_per_block / length),
                          [&](std::size_t begin, std::size_t end) {
                            for (std::size_t unit = begin; unit < end; ++unit) {
                              const std::size_t f = lines == 1 ? unit : unit / lines,
                                                first = lines == 1 ? 0 : unit % lines * length;
                              const int row = which[done + f];
                              interleave(rows.re.field(row).data() + first, rows.im.field(row).data() + first, length,
                                         reinterpret_cast<double*>(&fourier.at(static_cast<int>(f), first)));
                            }
                          });
    fourier.inverse(fields.subspan(done, count));
  }
}

void save_waves(StateWriter& state, const grids::Fourier& fourier, const grids::FieldSet& rows) {
  const grids::Transposition* const shared = fourier.transposition();
  if (shared == nullptr) {
    state.write(rows.all());
    return;
  }
  if (state.reader() == StateWriter::For::going_back) {
    state.write_part(rows.all(), static_cast<std::size_t>(rows.fields()) * shared->modes_of_whole());
    return;
  }
  for (int row = 0; row < rows.fields(); ++row) {
    grids::save_in_parts(state, *shared, rows.field(row));
  }
}

void restore_waves(StateReader& state, const grids::Fourier& fourier, grids::FieldSet& rows) {
  const grids::Transposition* const shared = fourier.transposition();
  if (shared == nullptr || state.reader() == StateWriter::For::going_back) {
    state.read(rows.all());
    return;
  }
  for (int row = 0; row < rows.fields(); ++row) {
    grids::restore_in_parts(state, *shared, shared->modes_of_whole(), rows.field(row));
  }
}

std::vector<double> parseval_weights(const grids::Fourier& fourier, const grids::Grid& grid) {
  const double nodes = static_cast<double>(grids::whole_of(grid).size());
  std::vector<double> weights(fourier.modes());
  for (std::size_t w = 0; w < weights.size(); ++w) {
    const auto k = fourier.wave(w)[0];
    const bool alone = k == 0 || 2 * static_cast<std::size_t>(k) == grid.cells(0);
    weights[w] = (alone ? 1.0 : 2.0) / nodes;
  }
  return weights;
}

}  // namespace rubato
