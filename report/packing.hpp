#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace rubato::report {

/// RFC 4648, with padding.
[[nodiscard]] std::string base64(std::span<const std::byte> bytes);

/// Writes JSON that may stand inside an HTML script element: `<` is escaped, so that no text in it can end the element.
/// Commas are put where they belong; nothing checks that what is begun is ended.
class Json {
public:
  Json& begin_object() { return open('{'); }
  Json& end_object() { return close('}'); }
  Json& begin_array() { return open('['); }
  Json& end_array() { return close(']'); }
  Json& key(std::string_view name);

  Json& value(std::string_view text);
  Json& value(const char* text) { return value(std::string_view(text)); }
  Json& value(double number);  ///< 17 digits; null if it is not finite
  Json& value(std::size_t number);
  Json& value(bool truth);

  /// A key with its value.
  template <typename Value>
  Json& entry(std::string_view name, const Value& content) {
    key(name);
    return value(content);
  }

  [[nodiscard]] const std::string& text() const { return text_; }

private:
  Json& open(char bracket);
  Json& close(char bracket);
  void separate();

  std::string text_;
};

/// How the numbers of an array are written into the page, all little-endian and in base 64: {"type", "data"}.
/// In single precision a value is base + scale · number, where "base" and "scale" are given; what is not finite is NaN.
void write_f64(Json& json, std::span<const double> values);
void write_f32(Json& json, std::span<const double> values);
/// In 16 bits: a value is minimum + code · (maximum - minimum)/65534, the code 65535 stands for what is not finite. Off
/// by at most (maximum - minimum)/131068. {"type": "u16", "minimum", "maximum", "data"}
void write_u16(Json& json, std::span<const double> values, double minimum, double maximum);

/// Text between tags or in a quoted attribute.
[[nodiscard]] std::string escape_html(std::string_view text);

}  // namespace rubato::report
