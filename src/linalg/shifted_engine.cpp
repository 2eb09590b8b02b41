#include "linalg/shifted_engine.hpp"

#include "base/event.hpp"
#include "base/index.hpp"

#include <algorithm>
#include <type_traits>

namespace flexgram {

CommonPattern common_pattern(Mat K, Mat M, const std::vector<Mat>& terms,
                             MatrixKind kind) {
  static Event event("CommonPattern");
  const auto timed = event.timed();
  CommonPattern common;
  const bool whole = kind == MatrixKind::general;
  PetscInt n = 0, begin = 0, end = 0;
  FG_CALL(MatGetSize(K, &n, nullptr));
  FG_CALL(MatGetOwnershipRange(K, &begin, &end));
  common.entries.n = static_cast<int>(n);
  std::vector<int> place(as_size(n), -1);
  std::vector<PetscInt> columns;
  common.terms.resize(terms.size());
  std::vector<Mat> matrices{K, M};
  std::vector<std::vector<double>*> values{&common.k, &common.m};
  for (std::size_t t = 0; t < terms.size(); ++t) {
    matrices.push_back(terms[t]);
    values.push_back(&common.terms[t]);
  }
  std::size_t expected = 0; // of K: the others rarely have more
  for (PetscInt row = begin; row < end; ++row) {
    PetscInt count = 0;
    const PetscInt* list = nullptr;
    FG_CALL(MatGetRow(K, row, &count, &list, nullptr));
    expected += whole ? as_size(count)
                      : as_size(std::upper_bound(list, list + count, row) - list);
    FG_CALL(MatRestoreRow(K, row, &count, &list, nullptr));
  }
  for (auto* list : {&common.entries.row, &common.entries.column})
    list->reserve(expected);
  for (auto* list : values) list->reserve(expected);
  for (PetscInt row = begin; row < end; ++row) {
    const std::size_t first = common.entries.row.size();
    columns.clear();
    const auto slot = [&](PetscInt column) {
      int& position = place[as_size(column)];
      if (position < 0) {
        position = static_cast<int>(columns.size());
        columns.push_back(column);
        common.entries.row.push_back(static_cast<int>(row) + 1);
        common.entries.column.push_back(static_cast<int>(column) + 1);
        for (auto* list : values) list->push_back(0);
      }
      return first + as_size(position);
    };
    slot(row); // MUMPS wants the diagonal, zero or not
    for (std::size_t i = 0; i < matrices.size(); ++i) {
      if (!matrices[i]) continue;
      PetscInt count = 0;
      const PetscInt* list = nullptr;
      const PetscScalar* entries = nullptr;
      FG_CALL(MatGetRow(matrices[i], row, &count, &list, &entries));
      for (PetscInt c = 0; c < count && (whole || list[c] <= row); ++c) {
        const std::size_t position = slot(list[c]); // may grow the arrays
        (*values[i])[position] = entries[c];
      }
      FG_CALL(MatRestoreRow(matrices[i], row, &count, &list, &entries));
    }
    for (PetscInt column : columns) place[as_size(column)] = -1;
  }
  return common;
}

namespace {

template <class T>
constexpr bool is_complex = !std::is_floating_point_v<T>;

template <class Scalar>
class EngineOf final : public Engine {
public:
  EngineOf(MPI_Comm comm, const MumpsOptions& options, MatrixKind kind)
      : mumps_(comm, options, kind) {}

  FactorEstimate analyse(const Pattern& entries, const PivotOrder& order) override {
    return mumps_.analyse(entries, order);
  }
  PivotOrder order() const override { return mumps_.order(); }

  void factorise(const CommonPattern& common, const ShiftCoefficients& c,
                 bool pivoting) override {
    std::vector<Scalar> values(common.k.size());
    const std::size_t terms = c.terms.size();
    for (std::size_t i = 0; i < values.size(); ++i) {
      std::complex<double> value = c.k * common.k[i] + c.m * common.m[i];
      for (std::size_t t = 0; t < terms; ++t) value += c.terms[t] * common.terms[t][i];
      values[i] = narrow(value);
    }
    mumps_.factorise(common.entries, std::move(values), pivoting);
  }

  void solve(RowRange rows, const double* re, const double* im, double* x_re,
             double* x_im, int columns) override {
    const std::size_t count = as_size(rows.size()) * as_size(columns);
    if constexpr (std::is_same_v<Scalar, double>) {
      std::copy_n(re, count, x_re);
      mumps_.solve(rows, {x_re, count}, columns);
      return;
    }
    std::vector<Scalar> x(count);
    for (std::size_t i = 0; i < count; ++i) x[i] = narrow({re[i], im ? im[i] : 0.0});
    mumps_.solve(rows, x, columns);
    for (std::size_t i = 0; i < count; ++i) {
      x_re[i] = std::real(x[i]);
      if constexpr (is_complex<Scalar>) x_im[i] = std::imag(x[i]);
    }
  }

  int negative_pivots() const override { return mumps_.negative_pivots(); }
  int null_pivots() const override { return mumps_.null_pivots(); }
  void count_pivots(bool count) override { mumps_.tolerate_null_pivots(count); }

private:
  static Scalar narrow(std::complex<double> value) {
    if constexpr (is_complex<Scalar>)
      return Scalar(value);
    else
      return static_cast<Scalar>(value.real());
  }
  Mumps<Scalar> mumps_;
};

} // namespace

std::unique_ptr<Engine> make_engine(MPI_Comm comm, bool real, bool single,
                                    const MumpsOptions& options, MatrixKind kind) {
  if (real && single) return std::make_unique<EngineOf<float>>(comm, options, kind);
  if (real) return std::make_unique<EngineOf<double>>(comm, options, kind);
  if (single) return std::make_unique<EngineOf<std::complex<float>>>(comm, options, kind);
  return std::make_unique<EngineOf<std::complex<double>>>(comm, options, kind);
}

} // namespace flexgram
