#include "linalg/accurate_inner.hpp"

#include "linalg/accurate_sum.hpp"

#include <cstring>
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

} // namespace

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
  AccurateDense result{Dense(rows, columns), Dense(rows, columns)};
  for (std::size_t i = 0; i < sums.size(); ++i) {
    result.hi.data[i] = static_cast<double>(sums[i]);
    result.lo.data[i] =
        static_cast<double>(sums[i] - static_cast<long double>(result.hi.data[i]));
  }
  return result;
}

} // namespace flexgram
