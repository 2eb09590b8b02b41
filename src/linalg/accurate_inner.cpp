#include "linalg/accurate_inner.hpp"

#include "linalg/accurate_sum.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

namespace flexgram {
namespace {

FLEXGRAM_FOR_EACH_PROCESSOR
void add_products(const double* a, const double* b, std::ptrdiff_t n, AccurateSum* sum) {
  AccurateSum here = *sum;
  std::ptrdiff_t k = 0;
  for (; k + AccurateSum::lanes <= n; k += AccurateSum::lanes)
    here.add(*reinterpret_cast<const AccurateSum::Doubles*>(a + k),
             *reinterpret_cast<const AccurateSum::Doubles*>(b + k));
  if (k < n) {
    AccurateSum::Doubles left{}, right{};
    std::memcpy(&left, a + k, sizeof(double) * static_cast<std::size_t>(n - k));
    std::memcpy(&right, b + k, sizeof(double) * static_cast<std::size_t>(n - k));
    here.add(left, right);
  }
  *sum = here;
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

AccurateDense inner_accurately(const Block& x, const Block& y, const Block& rest,
                               Triangle triangle) {
  constexpr std::ptrdiff_t together = 2048; // rows, which stay in the cache
  const int rows = static_cast<int>(x.columns()), columns = static_cast<int>(y.columns());
  const std::ptrdiff_t n = x.local_rows().size();
  const bool upper = triangle == Triangle::upper;
  const auto at = [rows](int i, int j) {
    return static_cast<std::size_t>(i) +
           static_cast<std::size_t>(j) * static_cast<std::size_t>(rows);
  };
  std::vector<AccurateSum> parts(static_cast<std::size_t>(rows) *
                                 static_cast<std::size_t>(columns));
  {
    const Block::Access left(x), right(y);
    for (std::ptrdiff_t first = 0; first < n; first += together)
      for (int j = 0; j < columns; ++j)
        for (int i = 0; i < (upper ? j + 1 : rows); ++i)
          add_products(left.column(i) + first, right.column(j) + first,
                       std::min(together, n - first), &parts[at(i, j)]);
  }
  std::vector<long double> sums(parts.size(), 0.0L);
  for (std::size_t k = 0; k < parts.size(); ++k)
    for (int l = 0; l < AccurateSum::lanes; ++l)
      sums[k] += static_cast<long double>(parts[k].hi[l]) +
                 static_cast<long double>(parts[k].lo[l]);
  MPI_Allreduce(MPI_IN_PLACE, sums.data(), static_cast<int>(sums.size()), MPI_LONG_DOUBLE,
                MPI_SUM, x.comm());
  if (rest) {
    const Dense small = inner(x, rest);
    for (std::size_t k = 0; k < sums.size(); ++k)
      sums[k] += static_cast<long double>(small.data[k]);
  }
  if (upper)
    for (int j = 0; j < columns; ++j)
      for (int i = 0; i < j; ++i) sums[at(j, i)] = sums[at(i, j)];
  return rounded(sums, rows, columns);
}

} // namespace flexgram
