#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <fmt/format.h>

/// What the figures of the documentation are drawn with, as SVG.

struct Point {
  double x, y;
};
using Points = std::vector<Point>;

/// One pair of axes, on which curves and marks are drawn.
class Figure {
public:
  Figure(std::string title, std::string x_label, std::string y_label, Point low, Point high)
      : title_(std::move(title)), x_label_(std::move(x_label)), y_label_(std::move(y_label)), low_(low), high_(high) {}

  void curve(const Points& points, const std::string& colour, bool dashed = false) {
    std::string path;
    for (const Point& point : points) {
      path += fmt::format("{:.1f},{:.1f} ", x(point.x), y(point.y));
    }
    body_ += fmt::format("<polyline points=\"{}\" fill=\"none\" stroke=\"{}\"{}/>\n", path, colour,
                         dashed ? " stroke-dasharray=\"5 4\"" : "");
  }
  void marks(const Points& points, const std::string& colour, double radius = 2.5) {
    for (const Point& point : points) {
      body_ += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{}\" fill=\"{}\"/>\n", x(point.x), y(point.y),
                           radius, colour);
    }
  }
  void note(Point at, const std::string& text, const std::string& colour) {
    body_ += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" fill=\"{}\">{}</text>\n", x(at.x), y(at.y), colour, text);
  }

  void write(const std::filesystem::path& file) const { std::ofstream(file) << text(); }
  [[nodiscard]] std::string text() const {
    std::string out = fmt::format(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" height=\"{1}\" "
        "font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
        "<clipPath id=\"c\"><rect x=\"{2}\" y=\"{3}\" width=\"{4}\" height=\"{5}\"/></clipPath>\n"
        "<rect x=\"{2}\" y=\"{3}\" width=\"{4}\" height=\"{5}\" fill=\"none\" stroke=\"#888\"/>\n",
        width, height, left, top, width - left - right, height - top - bottom);
    for (int i = 0; i <= 4; ++i) {
      const double tx = low_.x + i * (high_.x - low_.x) / 4;
      const double ty = low_.y + i * (high_.y - low_.y) / 4;
      out += fmt::format("<text x=\"{:.1f}\" y=\"{}\" text-anchor=\"middle\">{:.4g}</text>\n", x(tx),
                         height - bottom + 16, tx) +
             fmt::format("<text x=\"{}\" y=\"{:.1f}\" text-anchor=\"end\">{:.3g}</text>\n", left - 6, y(ty) + 4, ty);
    }
    out +=
        fmt::format("<text x=\"{}\" y=\"18\" text-anchor=\"middle\" font-size=\"14\">{}</text>\n", width / 2, title_) +
        fmt::format("<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>\n", width / 2, height - 8, x_label_) +
        fmt::format("<text transform=\"translate(14 {}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n", height / 2,
                    y_label_);
    return out + "<g clip-path=\"url(#c)\" stroke-width=\"1.5\">\n" + body_ + "</g>\n</svg>\n";
  }

private:
  static constexpr int width = 640, height = 320, left = 74, right = 16, top = 28, bottom = 44;
  [[nodiscard]] double x(double value) const {
    return left + (value - low_.x) / (high_.x - low_.x) * (width - left - right);
  }
  [[nodiscard]] double y(double value) const {
    return height - bottom - (value - low_.y) / (high_.y - low_.y) * (height - top - bottom);
  }
  std::string title_, x_label_, y_label_, body_;
  Point low_, high_;
};

inline constexpr const char* blue = "#1f5fa8";
inline constexpr const char* red = "#c0392b";
inline constexpr const char* grey = "#999999";
inline constexpr const char* green = "#2e8b57";
