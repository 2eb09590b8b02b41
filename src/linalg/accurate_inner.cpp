#include "linalg/accurate_inner.hpp"

#include "base/index.hpp"
#include "linalg/lanes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

constexpr int lanes = accurate_lanes;

/// What an accurate sum is between two stretches of rows.
struct Sums {
  double hi[lanes] = {}, lo[lanes] = {};
};

struct AddProducts {
  template <int native>
  [[gnu::always_inline]] static void run(const double* a, const double* b,
                                         std::ptrdiff_t n, Sums* sums) {
    AccurateSum<native> sum;
    typename AccurateSum<native>::Numbers left, right;
    sum.hi.load(sums->hi);
    sum.lo.load(sums->lo);
    std::ptrdiff_t k = 0;
    for (; k + lanes <= n; k += lanes) {
      left.load(a + k);
      right.load(b + k);
      sum.add(left, right);
    }
    if (k < n) {
      double of_a[lanes] = {}, of_b[lanes] = {};
      std::copy(a + k, a + n, of_a);
      std::copy(b + k, b + n, of_b);
      left.load(of_a);
      right.load(of_b);
      sum.add(left, right);
    }
    sum.hi.store(sums->hi);
    sum.lo.store(sums->lo);
  }
};

AccurateDense rounded(const std::vector<long double>& values, int rows, int columns) {
  AccurateDense result{Dense(rows, columns), Dense(rows, columns)};
  for (std::size_t i = 0; i < values.size(); ++i) {
    result.hi.data[i] = static_cast<double>(values[i]);
    result.lo.data[i] =
        static_cast<double>(values[i] - static_cast<long double>(result.hi.data[i]));
  }
  return result;
}

constexpr std::size_t slices = 4;

/// Binary digits of a slice: sums of k products of these are exact.
int digits_of_slices(int k) {
  return (std::numeric_limits<double>::digits - std::ilogb(std::max(k, 1)) - 1) / 2;
}

/// A = Σ slices, each with so few digits that sums of k products of them are exact. Of each
/// row, or of each column, the digits count from its largest entry.
std::array<Dense, slices> sliced(Dense a, int k, bool by_rows) {
  const int digits = digits_of_slices(k);
  std::array<Dense, slices> parts;
  std::vector<double> largest(as_size(by_rows ? a.rows : a.columns));
  for (Dense& part : parts) {
    std::fill(largest.begin(), largest.end(), 0.0);
    const auto of = [&](int i, int j) -> double& {
      return largest[as_size(by_rows ? i : j)];
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

namespace {

/// With hi the sum rounded to doubles.
AccurateDense in_order(AccurateDense sum) {
  for (std::size_t i = 0; i < sum.hi.data.size(); ++i) {
    const double x = sum.hi.data[i], y = sum.lo.data[i], hi = x + y, of_y = hi - x;
    sum.lo.data[i] = (x - (hi - of_y)) + (y - of_y);
    sum.hi.data[i] = hi;
  }
  return sum;
}

} // namespace

/// Products of slices that are left out, six of them, and digits beyond the last slice are at most
/// 2^(−4 digits) of the largest each; sums of ten numbers with twice the digits lose 2^−100.
double product_rounding(int k) {
  return std::ldexp(8.0 * k, -static_cast<int>(slices) * digits_of_slices(k)) +
         std::ldexp(1.0 * k, -100);
}

AccurateDense multiply_accurately(const Dense& a, const Dense& b) {
  const auto left = sliced(a, a.columns, true), right = sliced(b, a.columns, false);
  AccurateDense sum{Dense(a.rows, b.columns), Dense(a.rows, b.columns)};
  for (std::size_t both = slices; both-- > 0;) // the small ones first
    for (std::size_t r = 0; r <= both; ++r) {
      const Dense product = multiply(left[r], right[both - r]);
      for (std::size_t i = 0; i < product.data.size(); ++i) {
        const double x = sum.hi.data[i], y = product.data[i], hi = x + y, of_y = hi - x;
        sum.lo.data[i] += (x - (hi - of_y)) + (y - of_y);
        sum.hi.data[i] = hi;
      }
    }
  return in_order(std::move(sum));
}

Congruence congruence(const AccurateDense& a, const Dense& U) {
  const AccurateDense right = multiply_accurately(a.hi, U);
  Dense rest = multiply(a.lo, U);
  add_to(rest, right.lo);
  const Dense Ut = transpose(U);
  Congruence result{multiply_accurately(Ut, right.hi), {}};
  rest = multiply(Ut, rest);
  add_to(result.product.lo, rest);
  result.product = in_order(std::move(result.product));

  // Entry (i, j) is wrong by q (g_i a_j + a_i h_j) at most, with largest entries a of columns of U
  // and h of AU, and g = |U|ᵀ times the largest of the rows of A.
  const auto largest = [](const Dense& of) {
    std::vector<double> sizes;
    for (int j = 0; j < of.columns; ++j) {
      double most = 0;
      for (int i = 0; i < of.rows; ++i) most = std::max(most, std::abs(of(i, j)));
      sizes.push_back(most);
    }
    return sizes;
  };
  const std::vector<double> of_U = largest(U), of_AU = largest(right.hi),
                            of_A = largest(a.hi);
  double all_U = 0, all_A = 0;
  std::vector<double> forces;
  for (int j = 0; j < U.columns; ++j) {
    const auto at = as_size(j);
    double force = of_AU[at];
    for (int i = 0; i < U.rows; ++i) force += std::abs(U(i, j)) * of_A[as_size(i)];
    forces.push_back(force);
    all_U += of_U[at];
    all_A += force;
  }
  // Twice that, as the other triangle is wrong by as much; products of what is in `lo` lose less.
  const double root = std::sqrt(4 * product_rounding(U.rows)),
               t = all_U > 0 && all_A > 0 ? std::sqrt(all_A / all_U) : 1;
  for (std::size_t j = 0; j < forces.size(); ++j)
    result.rounding.push_back(root * (t * of_U[j] + forces[j] / t));
  return result;
}

AccurateDense inner_accurately(const Block& x, const Block& y, const Block& rest,
                               Triangle triangle) {
  constexpr std::ptrdiff_t together = 2048; // rows, which stay in the cache
  const int rows = static_cast<int>(x.columns()), columns = static_cast<int>(y.columns());
  const std::ptrdiff_t n = x.local_rows().size();
  const bool upper = triangle == Triangle::upper;
  const auto at = [rows](int i, int j) {
    return as_size(i) + as_size(j) * as_size(rows);
  };
  std::vector<Sums> parts(as_size(rows) * as_size(columns));
  {
    const Block::Access left(x), right(y);
    for (std::ptrdiff_t first = 0; first < n; first += together)
      for (int j = 0; j < columns; ++j)
        for (int i = 0; i < (upper ? j + 1 : rows); ++i)
          run_on_processor<AddProducts>(left.column(i) + first, right.column(j) + first,
                                        std::min(together, n - first), &parts[at(i, j)]);
  }
  std::vector<long double> sums(parts.size(), 0.0L);
  for (std::size_t k = 0; k < parts.size(); ++k)
    for (int l = 0; l < lanes; ++l)
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
