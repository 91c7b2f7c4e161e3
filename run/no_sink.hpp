#pragma once

#include <rubato/run/row_sink.hpp>

namespace rubato {

/// Takes rows that nobody wants: a record has them already, or there is none.
class NoSink final : public RowSink {
public:
  using RowSink::append;

  void append(record::Column /*column*/, std::span<const double> /*row*/) override {}
  void append(record::Column /*column*/, std::span<const std::int64_t> /*row*/) override {}
  void append_part(record::Column /*column*/, std::span<const double> /*part*/, bool /*is_last*/) override {}
  InParts in_parts(std::span<const record::Column> /*columns*/) override {
    return {.wanted = InParts::Wanted::checksum, .file = {}, .rows = {}};
  }
  void append_checksum(record::Column /*column*/, const Checksum& /*row*/) override {}
};

}  // namespace rubato
