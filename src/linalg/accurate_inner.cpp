#include "linalg/accurate_inner.hpp"

#include "linalg/accurate_sum.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>

namespace flexgram {
namespace {

FLEXGRAM_FOR_EACH_PROCESSOR
void accurate_dot(const double* a, const double* b, std::ptrdiff_t n, double* hi,
                  double* lo) {
  AccurateSum sum;
  std::ptrdiff_t k = 0;
  for (; k + AccurateSum::lanes <= n; k += AccurateSum::lanes)
    sum.add(*reinterpret_cast<const AccurateSum::Doubles*>(a + k),
            *reinterpret_cast<const AccurateSum::Doubles*>(b + k));
  if (k < n) {
    AccurateSum::Doubles left{}, right{};
    std::memcpy(&left, a + k, sizeof(double) * static_cast<std::size_t>(n - k));
    std::memcpy(&right, b + k, sizeof(double) * static_cast<std::size_t>(n - k));
    sum.add(left, right);
  }
  std::memcpy(hi, &sum.hi, sizeof sum.hi);
  std::memcpy(lo, &sum.lo, sizeof sum.lo);
}

AccurateDense rounded(const std::vector<long double>& values, int rows, int columns) {
  AccurateDense result{Dense(rows, columns), Dense(rows, columns)};
  for (std::size_t i = 0; i < values.size(); ++i) {
    result.hi.data[i] = static_cast<double>(values[i]);
    result.lo.data[i] =
        static_cast<double>(values[i] - static_cast<long double>(result.hi.data[i]));
  }
  return result;
}

constexpr int slices = 3; // of 20 digits or more: together all that a double has

/// A = Σ slices, each with so few digits that sums of k products of them are exact. Of each
/// row, or of each column, the digits count from its largest entry.
std::array<Dense, slices> sliced(Dense a, int k, bool by_rows) {
  const int digits =
      (std::numeric_limits<double>::digits - std::ilogb(std::max(k, 1)) - 1) / 2;
  std::array<Dense, slices> parts;
  std::vector<double> largest(static_cast<std::size_t>(by_rows ? a.rows : a.columns));
  for (Dense& part : parts) {
    std::fill(largest.begin(), largest.end(), 0.0);
    const auto of = [&](int i, int j) -> double& {
      return largest[static_cast<std::size_t>(by_rows ? i : j)];
    };
    for (int j = 0; j < a.columns; ++j)
      for (int i = 0; i < a.rows; ++i) of(i, j) = std::max(of(i, j), std::abs(a(i, j)));
    for (double& m :
         largest) // adding it and taking it away again leaves the leading digits
      m = m > 0 ? std::ldexp(0.75, std::ilogb(m) + 1 +
                                       std::numeric_limits<double>::digits - digits)
                : 0.0;
    part = Dense(a.rows, a.columns);
    for (int j = 0; j < a.columns; ++j)
      for (int i = 0; i < a.rows; ++i) {
        const volatile double shifted = a(i, j) + of(i, j); // not to be simplified
        part(i, j) = shifted - of(i, j);
        a(i, j) -= part(i, j);
      }
  }
  return parts;
}

} // namespace

AccurateDense multiply_accurately(const Dense& a, const Dense& b) {
  const auto left = sliced(a, a.columns, true), right = sliced(b, a.columns, false);
  std::vector<long double> sums(static_cast<std::size_t>(a.rows) *
                                static_cast<std::size_t>(b.columns));
  for (std::size_t r = slices; r-- > 0;)
    for (std::size_t s = slices; s-- > 0;) {
      const Dense product = multiply(left[r], right[s]);
      for (std::size_t i = 0; i < sums.size(); ++i)
        sums[i] += static_cast<long double>(product.data[i]);
    }
  return rounded(sums, a.rows, b.columns);
}

AccurateDense congruence(const AccurateDense& a, const Dense& U) {
  const AccurateDense right = multiply_accurately(a.hi, U);
  Dense rest = multiply(a.lo, U);
  for (std::size_t i = 0; i < rest.data.size(); ++i) rest.data[i] += right.lo.data[i];
  const Dense Ut = transpose(U);
  AccurateDense result = multiply_accurately(Ut, right.hi);
  rest = multiply(Ut, rest);
  for (std::size_t i = 0; i < rest.data.size(); ++i) result.lo.data[i] += rest.data[i];
  return result;
}

AccurateDense inner_accurately(const Block& x, const Block& y, const Block& rest) {
  const int rows = static_cast<int>(x.columns()), columns = static_cast<int>(y.columns());
  const std::ptrdiff_t n = x.local_rows().size();
  std::vector<long double> sums;
  {
    const Block::Access left(x), right(y);
    std::optional<Block::Access> small;
    if (rest) small.emplace(rest);
    for (int j = 0; j < columns; ++j)
      for (int i = 0; i < rows; ++i) {
        double hi[AccurateSum::lanes], lo[AccurateSum::lanes];
        accurate_dot(left.column(i), right.column(j), n, hi, lo);
        long double sum = 0;
        for (int l = 0; l < AccurateSum::lanes; ++l)
          sum += static_cast<long double>(hi[l]) + static_cast<long double>(lo[l]);
        double of_rest = 0;
        for (std::ptrdiff_t k = 0; small && k < n; ++k)
          of_rest += left.column(i)[k] * small->column(j)[k];
        sums.push_back(sum + static_cast<long double>(of_rest));
      }
  }
  MPI_Allreduce(MPI_IN_PLACE, sums.data(), static_cast<int>(sums.size()), MPI_LONG_DOUBLE,
                MPI_SUM, x.comm());
  return rounded(sums, rows, columns);
}

} // namespace flexgram
