#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <random>

#include <catch2/catch.hpp>

#include <rubato/report/packing.hpp>

#include "page_reader.hpp"

using namespace rubato::report;
using sample::decoded;

namespace {

std::string encoded(std::string_view text) {
  return base64(std::as_bytes(std::span(text)));
}

std::string field_of(const std::string& json, const std::string& key) {
  const std::string name = '"' + key + R"(":")";
  const std::size_t begin = json.find(name) + name.size();
  return json.substr(begin, json.find('"', begin) - begin);
}

}  // namespace

TEST_CASE("base 64 is that of RFC 4648") {
  // Section 10 of the RFC.
  const std::map<std::string, std::string> known{{"", ""},
                                                 {"f", "Zg=="},
                                                 {"fo", "Zm8="},
                                                 {"foo", "Zm9v"},
                                                 {"foob", "Zm9vYg=="},
                                                 {"fooba", "Zm9vYmE="},
                                                 {"foobar", "Zm9vYmFy"}};
  for (const auto& [text, code] : known) {
    CHECK(encoded(text) == code);
  }
}

TEST_CASE("16 bits hold a value to a 131068th of the range") {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-2.0, 5.0);
  std::vector<double> values(1000);
  for (double& value : values) {
    value = uniform(random);
  }
  values[10] = -2.0;
  values[20] = 5.0;
  values[30] = std::numeric_limits<double>::quiet_NaN();
  Json json;
  write_u16(json, values, -2.0, 5.0);
  const std::vector<unsigned char> bytes = decoded(field_of(json.text(), "data"));
  REQUIRE(bytes.size() == 2 * values.size());
  const double step = 7.0 / 65534;
  double largest = 0.0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const unsigned code = bytes[2 * i] + 256U * bytes[2 * i + 1];
    if (i == 30) {
      CHECK(code == 65535);
    } else {
      largest = std::max(largest, std::abs(-2.0 + code * step - values[i]));
    }
  }
  CHECK(largest <= step / 2 * (1 + 1e-9));
  CHECK(largest > step / 4);  // not better than it can be: the values really went through 16 bits
}

TEST_CASE("arrays keep their numbers") {
  const std::vector<double> values{1.0, -0.1, 1e-300, std::numeric_limits<double>::quiet_NaN()};
  Json json;
  write_f64(json, values);
  const auto bytes = decoded(field_of(json.text(), "data"));
  CHECK(std::memcmp(bytes.data(), values.data(), bytes.size()) == 0);
  Json single;
  write_f32(single, values);
  CHECK(decoded(field_of(single.text(), "data")).size() == 4 * values.size());
}

TEST_CASE("single precision is that of what varies, and exponents have no limits") {
  const auto worst = [](const std::vector<double>& values) {
    Json json;
    write_f32(json, values);
    const std::vector<double> numbers = sample::numbers_after(json.text(), {});
    double largest = 0.0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      largest = std::max(largest, std::abs(numbers[i] - values[i]));
    }
    return largest;
  };
  CHECK(worst({0.05, 0.05 + 1e-12, 0.05 - 1e-12}) <= 1e-12 * 6e-8);
  CHECK(worst({1e60, -3e60, 0.0}) <= 3e60 * 6e-8);
  CHECK(worst({1e-60, -3e-60, 0.0}) <= 3e-60 * 6e-8);
  CHECK(worst({1.0, -0.1, 0.3}) > 1e-9);  // it is single precision
  Json json;
  write_f32(json, std::vector{1.0, std::numeric_limits<double>::infinity()});
  CHECK(std::isnan(sample::numbers_after(json.text(), {}).back()));
}

TEST_CASE("16 bits hold the largest numbers there are") {
  const double most = std::numeric_limits<double>::max();
  Json json;
  write_u16(json, std::vector{-most, 0.0, most, 0.0}, -most, most);
  CHECK(sample::numbers_after(json.text(), {}) == std::vector{0.0, 32767.0, 65534.0, 32767.0});
  Json constant;
  write_u16(constant, std::vector{5.0, 5.0}, 5.0, 5.0);
  CHECK(sample::numbers_after(constant.text(), {}) == std::vector{0.0, 0.0});
}

TEST_CASE("text in JSON cannot end the script that holds it") {
  Json json;
  json.begin_object().entry("title", "a</script><script>alert(\"1\")</script> \\ \n\t\x01 Γ");
  json.key("empty").begin_array().end_array();
  json.key("numbers").begin_array().value(0.1).value(std::nan("")).value(std::size_t{3}).value(true).end_array();
  json.end_object();
  CHECK(json.text() == R"({"title":"a\u003c/script>\u003cscript>alert(\"1\")\u003c/script> \\ \n\t\u0001 Γ",)"
                       R"("empty":[],"numbers":[0.10000000000000001,null,3,true]})");
}

TEST_CASE("text in HTML is text") {
  CHECK(escape_html(R"(<b a="1" b='2'>&amp;)") == "&lt;b a=&quot;1&quot; b=&#39;2&#39;&gt;&amp;amp;");
}
