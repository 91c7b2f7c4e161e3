#include "audit/series.hpp"

#include <map>
#include <memory>
#include <utility>

namespace audit {

namespace {

void list_monomials(std::size_t variable, std::size_t variables, std::size_t left, Shape::Exponents& exponents,
                    std::vector<Shape::Exponents>& found) {
  if (variable + 1 == variables) {
    exponents[variable] = static_cast<std::uint8_t>(left);
    found.push_back(exponents);
    return;
  }
  for (std::size_t power = left + 1; power-- > 0;) {
    exponents[variable] = static_cast<std::uint8_t>(power);
    list_monomials(variable + 1, variables, left - power, exponents, found);
  }
}

std::size_t total(const Shape::Exponents& exponents) {
  std::size_t sum = 0;
  for (const std::uint8_t exponent : exponents) {
    sum += exponent;
  }
  return sum;
}

}  // namespace

Shape::Shape(std::size_t variable_count, std::size_t most) : variables(variable_count), degree(most) {
  for (std::size_t d = 0; d <= degree; ++d) {
    Exponents exponents = {};
    list_monomials(0, variables, d, exponents, monomials);
  }
  std::map<Exponents, std::uint32_t> number;
  for (std::uint32_t i = 0; i < monomials.size(); ++i) {
    number[monomials[i]] = i;
  }
  for (std::uint32_t i = 0; i < monomials.size(); ++i) {
    for (std::uint32_t j = 0; j < monomials.size() && total(monomials[i]) + total(monomials[j]) <= degree; ++j) {
      Exponents sum = monomials[i];
      for (std::size_t v = 0; v < variables; ++v) {
        sum[v] = static_cast<std::uint8_t>(sum[v] + monomials[j][v]);
      }
      products.push_back({i, j, number.at(sum)});
    }
  }
  raised.assign(variables, std::vector<std::size_t>(monomials.size(), monomials.size()));
  for (std::size_t v = 0; v < variables; ++v) {
    for (std::size_t i = 0; i < monomials.size(); ++i) {
      Exponents higher = monomials[i];
      ++higher[v];
      if (const auto found = number.find(higher); found != number.end()) {
        raised[v][i] = found->second;
      }
    }
  }
}

std::size_t Shape::index(std::size_t variable, std::size_t power) const {
  std::size_t monomial = 0;
  for (std::size_t i = 0; i < power; ++i) {
    monomial = raised[variable][monomial];
  }
  return monomial;
}

const Shape& Shape::of(std::size_t variables, std::size_t degree) {
  static std::map<std::pair<std::size_t, std::size_t>, std::unique_ptr<Shape>> shapes;
  auto& shape = shapes[{variables, degree}];
  if (shape == nullptr) {
    shape = std::make_unique<Shape>(variables, degree);
  }
  return *shape;
}

Series& Series::operator+=(const Series& other) {
  for (std::size_t i = 0; i < coefficients_.size(); ++i) {
    coefficients_[i] += other.coefficients_[i];
  }
  return *this;
}

Series Series::operator-() const {
  Series result = *this;
  for (Bounded& coefficient : result.coefficients_) {
    coefficient = -coefficient;
  }
  return result;
}

Series operator*(const Series& a, const Series& b) {
  Series result(a.shape(), 0.0L);
  for (const auto& [left, right, at] : a.shape().products) {
    if (a[left].value != 0 && b[right].value != 0) {
      result[at] += a[left] * b[right];
    }
  }
  return result;
}

Series operator*(const Bounded& factor, Series a) {
  for (Bounded& coefficient : a.coefficients_) {
    coefficient = factor * coefficient;
  }
  return a;
}

Series operator/(const Series& a, const Series& b) {
  std::vector<Bounded> inverse(b.shape().degree + 1);
  inverse[0] = Bounded(1.0L) / b.constant();
  for (std::size_t k = 1; k < inverse.size(); ++k) {
    inverse[k] = -(inverse[k - 1] * inverse[0]);
  }
  return a * b.composed(inverse);
}

Series Series::differentiated(std::size_t variable) const {
  Series result(*shape_, 0.0L);
  for (std::size_t i = 0; i < coefficients_.size(); ++i) {
    if (const std::size_t higher = shape_->raised[variable][i]; higher < coefficients_.size()) {
      result[i] = Bounded(static_cast<long double>(shape_->monomials[higher][variable])) * coefficients_[higher];
    }
  }
  return result;
}

Series Series::integrated(std::size_t variable) const {
  Series result(*shape_, 0.0L);
  for (std::size_t i = 0; i < coefficients_.size(); ++i) {
    if (const std::size_t higher = shape_->raised[variable][i]; higher < coefficients_.size()) {
      result[higher] = coefficients_[i] / Bounded(static_cast<long double>(shape_->monomials[higher][variable]));
    }
  }
  return result;
}

Series Series::composed(std::span<const Bounded> outer) const {
  Series inner = *this;
  inner[0] = 0.0L;
  Series result(*shape_, outer[shape_->degree]);
  for (std::size_t k = shape_->degree; k-- > 0;) {
    result = result * inner;
    result[0] += outer[k];
  }
  return result;
}

namespace {

/// The Taylor coefficients of a function whose derivatives repeat with period 4.
Series periodic(const Series& x, const std::array<Bounded, 4>& derivatives) {
  std::vector<Bounded> outer(x.shape().degree + 1);
  long double factorial = 1.0L;
  for (std::size_t k = 0; k < outer.size(); ++k) {
    factorial *= k > 0 ? static_cast<long double>(k) : 1.0L;
    outer[k] = derivatives[k % 4] / Bounded(factorial);
  }
  return x.composed(outer);
}

}  // namespace

Series sin(const Series& x) {
  const Bounded s = sin(x.constant()), c = cos(x.constant());
  return periodic(x, {s, c, -s, -c});
}

Series cos(const Series& x) {
  const Bounded s = sin(x.constant()), c = cos(x.constant());
  return periodic(x, {c, -s, -c, s});
}

Series exp(const Series& x) {
  const Bounded e = exp(x.constant());
  return periodic(x, {e, e, e, e});
}

Series log(const Series& x) {
  std::vector<Bounded> outer(x.shape().degree + 1);
  outer[0] = log(x.constant());
  Bounded power_of_inverse = 1.0L;
  for (std::size_t k = 1; k < outer.size(); ++k) {
    power_of_inverse = -power_of_inverse / x.constant();
    outer[k] = -power_of_inverse / Bounded(static_cast<long double>(k));
  }
  return x.composed(outer);
}

Series power(const Series& x, long double exponent) {
  std::vector<Bounded> outer(x.shape().degree + 1);
  outer[0] = power(x.constant(), exponent);
  for (std::size_t k = 1; k < outer.size(); ++k) {
    const auto number = static_cast<long double>(k);
    outer[k] = outer[k - 1] * Bounded((exponent - number + 1) / number) / x.constant();
  }
  return x.composed(outer);
}

}  // namespace audit
