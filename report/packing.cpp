#include <rubato/report/packing.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include <fmt/format.h>

#include <rubato/base/quoted.hpp>
#include <rubato/base/utf8.hpp>

namespace rubato::report {

static_assert(std::endian::native == std::endian::little, "numbers are packed as they lie in memory");

std::string base64(std::span<const std::byte> bytes) {
  static constexpr std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  const auto at = [&](std::size_t i) { return i < bytes.size() ? std::to_integer<unsigned>(bytes[i]) : 0U; };
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const unsigned group = at(i) << 16U | at(i + 1) << 8U | at(i + 2);
    text += digits[group >> 18U];
    text += digits[group >> 12U & 63U];
    text += i + 1 < bytes.size() ? digits[group >> 6U & 63U] : '=';
    text += i + 2 < bytes.size() ? digits[group & 63U] : '=';
  }
  return text;
}

Json& Json::open(char bracket) {
  separate();
  text_ += bracket;
  return *this;
}

Json& Json::close(char bracket) {
  text_ += bracket;
  return *this;
}

/// A comma is due unless something was just begun.
void Json::separate() {
  if (!text_.empty() && std::string_view("{[:").find(text_.back()) == std::string_view::npos) {
    text_ += ',';
  }
}

Json& Json::key(std::string_view name) {
  value(name);
  text_ += ':';
  return *this;
}

Json& Json::value(std::string_view text) {
  separate();
  // The object may stand in a <script> element, which any "</script>" in it would end.
  for (const char c : rubato::quoted(text)) {
    text_ += c == '<' ? std::string_view("\\u003c") : std::string_view(&c, 1);
  }
  return *this;
}

Json& Json::value(double number) {
  separate();
  text_ += std::isfinite(number) ? fmt::format("{:.17g}", number) : "null";
  return *this;
}

Json& Json::value(std::size_t number) {
  separate();
  text_ += fmt::format("{}", number);
  return *this;
}

Json& Json::value(bool truth) {
  separate();
  text_ += truth ? "true" : "false";
  return *this;
}

namespace {

template <typename Number>
void write_array(Json& json, std::string_view type, const std::vector<Number>& numbers) {
  json.entry("type", type).entry("data", base64(std::as_bytes(std::span(numbers))));
}

}  // namespace

void write_f64(Json& json, std::span<const double> values) {
  json.begin_object();
  write_array(json, "f64", std::vector<double>(values.begin(), values.end()));
  json.end_object();
}

void write_f32(Json& json, std::span<const double> values) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const double value : values) {
    if (std::isfinite(value)) {
      low = std::min(low, value);
      high = std::max(high, value);
    }
  }
  // Seven digits are of the variation where that is small, and exponents beyond those of single precision are kept.
  constexpr double narrow = 1e-3, smallest = 1e-30, largest = 1e30;
  const bool is_narrow = high > low && high / 2 - low / 2 < narrow * std::max(std::abs(low), std::abs(high));
  const double base = is_narrow ? low / 2 + high / 2 : 0.0;
  const double size = std::max(std::abs(low - base), std::abs(high - base));
  const bool is_far = std::isfinite(size) && size > 0.0 && (size < smallest || size > largest);
  const double scale = is_far ? std::ldexp(1.0, std::ilogb(size)) : 1.0;
  std::vector<float> numbers(values.size());
  std::ranges::transform(values, numbers.begin(), [&](double value) {
    return std::isfinite(value) ? static_cast<float>((value - base) / scale) : std::numeric_limits<float>::quiet_NaN();
  });
  json.begin_object();
  if (base != 0.0 || scale != 1.0) {
    json.entry("base", base).entry("scale", scale);
  }
  write_array(json, "f32", numbers);
  json.end_object();
}

void write_u16(Json& json, std::span<const double> values, double minimum, double maximum) {
  constexpr double most = 65534.0;
  constexpr std::uint16_t undefined = 65535;
  // In halves, since the difference of two numbers may be too large for one.
  const double range = maximum / 2 - minimum / 2;
  std::vector<std::uint16_t> codes(values.size());
  std::ranges::transform(values, codes.begin(), [&](double value) {
    const double part = range > 0.0 ? (value / 2 - minimum / 2) / range : 0.0;
    return std::isfinite(value) ? static_cast<std::uint16_t>(std::clamp(std::round(part * most), 0.0, most))
                                : undefined;
  });
  json.begin_object();
  json.entry("minimum", minimum).entry("maximum", maximum);
  write_array(json, "u16", codes);
  json.end_object();
}

std::string escape_html(std::string_view text) {
  std::string escaped;
  for (const char c : printable(text)) {
    switch (c) {
      case '&': escaped += "&amp;"; break;
      case '<': escaped += "&lt;"; break;
      case '>': escaped += "&gt;"; break;
      case '"': escaped += "&quot;"; break;
      case '\'': escaped += "&#39;"; break;
      default: escaped += c;
    }
  }
  return escaped;
}

}  // namespace rubato::report
