#pragma once

#include "base/index.hpp"
#include "base/observer.hpp"
#include "linalg/sparse.hpp"
#include "linalg/sparse_product.hpp"
#include "model/second_order_model.hpp"

#include <gtest/gtest.h>

#include <complex>
#include <functional>
#include <utility>
#include <vector>

/// Bodies whose answers are known in closed form, and small helpers.
namespace flexgram::examples {

inline MPI_Comm world() { return PETSC_COMM_WORLD; }

inline Observer& silent() {
  static Observer observer(world(), Observer::Level::silent);
  return observer;
}

/// n×n sparse matrix from a function of (row, column); zeros are left out.
inline Matrix sparse(PetscInt n, const std::function<double(PetscInt, PetscInt)>& entry,
                     PetscInt half_band) {
  const RowRange rows = even_rows(world(), n);
  LocalRows local;
  for (PetscInt i = rows.begin; i < rows.end; ++i) {
    for (PetscInt j = std::max<PetscInt>(0, i - half_band);
         j <= std::min<PetscInt>(n - 1, i + half_band); ++j)
      if (const double value = entry(i, j); value != 0) {
        local.column.push_back(j);
        local.value.push_back(value);
      }
    local.start.push_back(static_cast<PetscInt>(local.column.size()));
  }
  return make_sparse(world(), rows, n, local);
}

inline Block block(PetscInt n, PetscInt columns,
                   const std::function<double(PetscInt, PetscInt)>& entry) {
  Block b(world(), even_rows(world(), n), n, columns);
  Block::Access access(b);
  for (PetscInt j = 0; j < columns; ++j)
    for (PetscInt i = b.local_rows().begin; i < b.local_rows().end; ++i)
      access.column(j)[i - b.local_rows().begin] = entry(i, j);
  return b;
}

inline Block identity_block(PetscInt n) {
  return block(n, n, [](PetscInt i, PetscInt j) { return i == j ? 1.0 : 0.0; });
}

/// A sparse matrix whole on every rank, for small n.
inline Dense whole(Mat a) {
  PetscInt n = 0;
  FG_CALL(MatGetSize(a, &n, nullptr));
  const Block I = identity_block(n);
  return inner(I, multiply(a, I));
}

inline Dense whole(const Block& b) { return inner(identity_block(b.rows()), b); }

/// The same of a reduced body, which each rank holds whole.
inline Dense own(Mat a) { return to_dense(a); }
inline Dense own(const Block& b) {
  Dense all(static_cast<int>(b.rows()), static_cast<int>(b.columns()));
  const Block::Access access(b);
  std::copy_n(access.column(0), all.data.size(), all.data.begin());
  return all;
}

/// A chain of `half` equal masses and springs between two walls, twice: every eigenvalue
/// 2 − 2 cos(kπ/(half + 1)) is double. The load is on the first chain.
inline SecondOrderModel twin_chains(PetscInt half) {
  SecondOrderModel fom;
  fom.comm = world();
  fom.n = 2 * half;
  fom.rows = even_rows(world(), fom.n);
  fom.K = sparse(
      fom.n,
      [half](PetscInt i, PetscInt j) {
        if (i == j) return 2.0;
        return std::min(i, j) == half - 1 ? 0.0 : -1.0;
      },
      1);
  fom.M = sparse(
      fom.n, [](PetscInt i, PetscInt j) { return i == j ? 1.0 : 0.0; }, 0);
  fom.damping = {1e-3, 0, 0};
  fom.B = block(fom.n, 1, [](PetscInt i, PetscInt) { return i == 1 ? 1.0 : 0.0; });
  fom.C = fom.B.share();
  fom.inputs = fom.outputs = {"f"};
  return fom;
}

/// Fixed-free rod of n linear elements, E A = ρ A = L = 1, consistent mass. Discrete
/// eigenvalues: λ_k = 6/h² (1 − cos θ)/(2 + cos θ), θ = (2k − 1)π/(2n).
inline SecondOrderModel rod(PetscInt n, Damping damping = {}) {
  SecondOrderModel model;
  const double h = 1.0 / static_cast<double>(n);
  const auto last = [n](PetscInt i) { return i == n - 1; };
  model.name = "rod";
  model.comm = world();
  model.n = n;
  model.rows = even_rows(world(), n);
  model.K = sparse(
      n, [=](PetscInt i, PetscInt j) { return i == j ? (last(i) ? 1 : 2) / h : -1 / h; },
      1);
  model.M = sparse(
      n,
      [=](PetscInt i, PetscInt j) { return i == j ? (last(i) ? 2 : 4) * h / 6 : h / 6; },
      1);
  model.damping = damping;
  model.B = block(n, 2, [n](PetscInt i, PetscInt j) {
    return (j == 0 && i == n - 1) || (j == 1 && i == n / 2) ? 1.0 : 0.0;
  });
  model.C = model.B.share();
  model.inputs = model.outputs = {"tip.fx", "middle.fx"};
  return model;
}

inline double rod_eigenvalue(PetscInt n, PetscInt k) {
  const double theta =
      (2.0 * static_cast<double>(k) - 1) * M_PI / (2.0 * static_cast<double>(n));
  return 6.0 * static_cast<double>(n * n) * (1 - std::cos(theta)) / (2 + std::cos(theta));
}

/// The matrix of a new viscous term.
inline Matrix& dampers(SecondOrderModel& model) {
  return model.terms.emplace_back().matrix;
}

/// H(ω) = Cᵀ A(ω)⁻¹ B of a small model, by elimination with partial pivoting in long double:
/// a referee with eleven bits more than the doubles whose rounding is claimed. Collective.
class Referee {
public:
  explicit Referee(const SecondOrderModel& model) : n_(model.n), damping_(model.damping) {
    const auto all = [reduced = model.comm == PETSC_COMM_SELF](const auto& a) {
      return reduced ? own(a) : whole(a);
    };
    K_ = all(model.K);
    M_ = all(model.M);
    for (const auto& [law, T] : model.terms) terms_.push_back({law, all(T)});
    B_ = all(model.B);
    C_ = all(model.C);
  }

  ComplexDense transfer(double omega) const {
    using Number = std::complex<long double>;
    const auto n = as_size(n_);
    const auto inputs = as_size(B_.columns);
    const long double w = omega;
    const Number of_K(1, static_cast<long double>(damping_.eta) + w * damping_.beta),
        of_M(-w * w, w * damping_.alpha);
    std::vector<Number> g; // test_laws.cpp holds them against their definitions
    for (const auto& [law, T] : terms_)
      g.push_back(law.kind().coefficients({omega, omega}, 1).front());
    std::vector<std::vector<Number>> rows(n, std::vector<Number>(n + inputs));
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = 0; j < n; ++j) {
        const std::size_t at = i + j * n;
        rows[i][j] = of_K * static_cast<long double>(K_.data[at]) +
                     of_M * static_cast<long double>(M_.data[at]);
        for (std::size_t t = 0; t < terms_.size(); ++t)
          rows[i][j] += g[t] * static_cast<long double>(terms_[t].matrix.data[at]);
      }
      for (std::size_t j = 0; j < inputs; ++j) rows[i][n + j] = B_.data[i + j * n];
    }
    for (std::size_t k = 0; k < n; ++k) {
      std::size_t pivot = k;
      for (std::size_t i = k + 1; i < n; ++i)
        if (std::norm(rows[i][k]) > std::norm(rows[pivot][k])) pivot = i;
      std::swap(rows[k], rows[pivot]);
      for (std::size_t i = k + 1; i < n; ++i) {
        if (rows[i][k] == Number()) continue;
        const Number factor = rows[i][k] / rows[k][k];
        for (std::size_t j = k; j < n + inputs; ++j)
          if (rows[k][j] != Number()) rows[i][j] -= factor * rows[k][j];
      }
    }
    ComplexDense H(C_.columns, B_.columns);
    std::vector<Number> x(n);
    for (int j = 0; j < B_.columns; ++j) {
      for (std::size_t i = n; i-- > 0;) {
        x[i] = rows[i][n + as_size(j)];
        for (std::size_t l = i + 1; l < n; ++l)
          if (rows[i][l] != Number()) x[i] -= rows[i][l] * x[l];
        x[i] /= rows[i][i];
      }
      for (int i = 0; i < C_.columns; ++i) {
        Number sum = 0;
        for (std::size_t l = 0; l < n; ++l)
          sum += static_cast<long double>(C_.data[l + as_size(i) * n]) * x[l];
        H(i, j) = static_cast<std::complex<double>>(sum);
      }
    }
    return H;
  }

  std::vector<ComplexDense> transfer(const std::vector<double>& omega) const {
    std::vector<ComplexDense> H;
    for (double w : omega) H.push_back(transfer(w));
    return H;
  }

private:
  PetscInt n_;
  Damping damping_;
  Dense K_, M_, B_, C_;
  std::vector<Term<Dense>> terms_;
};

} // namespace flexgram::examples
