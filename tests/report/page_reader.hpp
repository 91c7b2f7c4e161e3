#pragma once

#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

/// A page as its scripts read it: what is in the JSON of a page, found by the text before it.
namespace sample {

inline std::string data_of(const std::string& page) {
  const std::string begin = R"(<script id="data" type="application/json">)";
  const std::size_t first = page.find(begin) + begin.size();
  return page.substr(first, page.find("</script>", first) - first);
}

/// The inverse of base64().
inline std::vector<unsigned char> decoded(std::string_view text) {
  static constexpr std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::vector<unsigned char> bytes;
  unsigned bits = 0, count = 0;
  for (const char c : text) {
    if (c == '=') {
      break;
    }
    bits = bits << 6U | static_cast<unsigned>(digits.find(c));
    count += 6;
    if (count >= 8) {
      count -= 8;
      bytes.push_back(static_cast<unsigned char>(bits >> count & 255U));
    }
  }
  return bytes;
}

/// The piece of `data` from the last of `places`, each searched after the one before. \throws std::logic_error
inline std::string_view after(std::string_view data, const std::vector<std::string>& places) {
  for (const std::string& place : places) {
    const std::size_t at = data.find(place);
    if (at == std::string_view::npos) {
      throw std::logic_error("the page has no " + place);
    }
    data.remove_prefix(at + place.size());
  }
  return data;
}

template <typename Number>
std::vector<double> as_numbers(const std::vector<unsigned char>& bytes) {
  std::vector<Number> numbers(bytes.size() / sizeof(Number));
  std::memcpy(numbers.data(), bytes.data(), bytes.size());
  return {numbers.begin(), numbers.end()};
}

/// The numbers of the packed array that comes next after `places`; codes of "u16" as they are.
inline std::vector<double> numbers_after(std::string_view data, const std::vector<std::string>& places) {
  data = after(data, places);
  const std::string_view type = after(data, {R"("type":")"}).substr(0, 3);
  const std::string_view text = after(data, {R"("data":")"});
  const std::vector<unsigned char> bytes = decoded(text.substr(0, text.find('"')));
  const std::string_view head = data.substr(0, data.find(R"("type":")"));
  const auto entry = [&](const char* key, double otherwise) {
    const std::size_t at = head.find(key);
    return at == std::string_view::npos ? otherwise : std::stod(std::string(head.substr(at + std::strlen(key))));
  };
  std::vector<double> numbers = type == "f64"   ? as_numbers<double>(bytes)
                                : type == "f32" ? as_numbers<float>(bytes)
                                                : as_numbers<std::uint16_t>(bytes);
  for (double& number : numbers) {
    number = entry(R"("base":)", 0.0) + entry(R"("scale":)", 1.0) * number;
  }
  return numbers;
}

}  // namespace sample
