#include "medium/cell_series.hpp"

#include "linalg/decompositions.hpp"

#include <algorithm>
#include <numeric>

namespace flexgram {

using Complex = std::complex<double>;

std::pair<Cell, Cell> Cell::halves(std::size_t v) const {
  std::pair<Cell, Cell> both{*this, *this};
  const double middle = both.first.side(v).centre();
  both.first.side(v).last = both.second.side(v).first = middle;
  return both;
}

int degree_of(const Powers& powers) {
  return std::accumulate(powers.begin(), powers.end(), 0);
}

CellFactors::CellFactors(const DenseSystem& system, const Cell& cell)
    : rest(2 + system.terms.size(), 0.0) {
  const Damping& d = system.damping;
  const double omega = cell.omega.centre(), h = cell.omega.half();
  const Complex i(0, 1);
  const auto add = [&](std::size_t matrix, const std::vector<Complex>& in_omega,
                       std::size_t variable = 0, int power = 0, double share = 1) {
    for (std::size_t k = 0; k < in_omega.size(); ++k) {
      if (in_omega[k] == 0.0 && k > 0) continue;
      Powers powers(cell.variables(), 0);
      powers[0] = static_cast<int>(k);
      if (variable > 0) powers[variable] = power;
      auto& here = of[powers];
      here.resize(rest.size(), 0.0);
      here[matrix] += share * in_omega[k];
    }
  };
  add(0, {1.0 + i * (d.eta + omega * d.beta), i * h * d.beta});
  add(1, {i * omega * d.alpha - omega * omega, h * (i * d.alpha - 2 * omega),
          Complex(-h * h)});
  std::vector<Law> parameters;
  for (std::size_t t = 0; t < system.terms.size(); ++t) {
    constexpr int degree = 2;
    const Law& law = system.terms[t].law;
    if (!law.varies()) {
      const LawSeries g = law.series(cell.omega, degree);
      add(2 + t, g.coefficients);
      rest[2 + t] += g.rest;
      continue;
    }
    const std::size_t place = place_among(parameters, law);
    const LawSeries g = law.with("value", law.number("most")).series(cell.omega, degree);
    const std::vector<double> shares = law.shares(cell.values[place]);
    for (std::size_t k = 0; k < shares.size(); ++k) {
      if (k > 0 && shares[k] == 0) continue;
      add(2 + t, g.coefficients, 1 + place, static_cast<int>(k), shares[k]);
      rest[2 + t] += std::abs(shares[k]) * g.rest;
    }
  }
}

std::vector<double> CellFactors::largest() const {
  std::vector<double> sum = rest;
  for (const auto& [powers, factors] : of)
    for (std::size_t m = 0; m < sum.size(); ++m) sum[m] += std::abs(factors[m]);
  return sum;
}

CellSeries series_of(const Matrices& matrices, const CellFactors& factors) {
  CellSeries A;
  for (const auto& [powers, of_each] : factors.of) {
    ComplexDense sum(matrices.front().rows, matrices.front().columns);
    for (std::size_t m = 0; m < matrices.size(); ++m) {
      if (of_each[m] == 0.0) continue;
      for (std::size_t l = 0; l < sum.data.size(); ++l)
        sum.data[l] += of_each[m] * matrices[m].data[l];
    }
    A.emplace(powers, std::move(sum));
  }
  return A;
}

void add_to(ComplexDense& a, const ComplexDense& b, double factor) {
  for (std::size_t l = 0; l < a.data.size(); ++l) a.data[l] += factor * b.data[l];
}

namespace {

void add_term(CellSeries& sum, const Powers& powers, const ComplexDense& a,
              double factor) {
  auto& here = sum[powers];
  if (here.data.empty()) here = ComplexDense(a.rows, a.columns);
  add_to(here, a, factor);
}

/// Product: of two coefficients.
template <class Product>
void add_products(const CellSeries& a, const CellSeries& b, double factor,
                  CellSeries& sum, const Product& product) {
  for (const auto& [k, left] : a)
    for (const auto& [l, right] : b) {
      Powers powers = k;
      for (std::size_t v = 0; v < powers.size(); ++v) powers[v] += l[v];
      add_term(sum, powers, product(left, right), factor);
    }
}

} // namespace

void add_to(CellSeries& sum, const CellSeries& b, double factor) {
  for (const auto& [powers, a] : b) add_term(sum, powers, a, factor);
}

void add_product(const CellSeries& A, const CellSeries& x, double factor,
                 CellSeries& sum) {
  add_products(A, x, factor, sum, [](const ComplexDense& a, const ComplexDense& b) {
    return multiply(a, b);
  });
}

CellSeries transposed_product(const CellSeries& y, const CellSeries& z) {
  CellSeries product;
  add_products(y, z, 1, product, [](const ComplexDense& a, const ComplexDense& b) {
    return multiply_transposed(a, b);
  });
  return product;
}

namespace {

/// At least the largest eigenvalue of a semidefinite matrix G, and at most a hundredth more: λ of the
/// power method where λ − G is definite, else by all eigenvalues, which takes ten times as long.
double largest_eigenvalue(const ComplexDense& G) {
  constexpr int steps = 8;
  constexpr double margin = 1.01;
  const ComplexDense square = multiply(G, G);
  ComplexDense x(G.rows, 1);
  for (int j = 0; j < G.columns;
       ++j) // of all columns, so that none is orthogonal by chance
    for (int i = 0; i < G.rows; ++i) x(i, 0) += (1 + 0.1 * (j % 7)) * G(i, j);
  double value = 0;
  for (int step = 0; step < steps; ++step) {
    const double size = frobenius_norm(x);
    if (!(size > 0) || !std::isfinite(size)) break;
    for (auto& entry : x.data) entry /= size;
    x = multiply(square, x);
    value = std::sqrt(frobenius_norm(x)) * margin;
  }
  ComplexDense left = G;
  for (auto& entry : left.data) entry = -entry;
  for (int i = 0; i < G.rows; ++i) left(i, i) += value;
  if (value > 0 && is_positive_definite(std::move(left))) return value;
  return hermitian_eigenvalues(G).back();
}

} // namespace

/// The root of the largest eigenvalue of the smaller Gram matrix; that is off by rounding of the
/// size of its norm.
double spectral_norm(const ComplexDense& a) {
  if (a.data.empty()) return 0;
  if (a.columns > a.rows) {
    ComplexDense b(a.columns, a.rows);
    for (int j = 0; j < a.columns; ++j)
      for (int i = 0; i < a.rows; ++i) b(j, i) = a(i, j);
    return spectral_norm(b);
  }
  const double square = largest_eigenvalue(multiply_transposed(a, a, true));
  return std::sqrt(std::max(square, 0.0)) * (1 + 1e-10);
}

double spectral_norm(const Dense& a) {
  if (a.data.empty()) return 0;
  const Dense gram = a.columns > a.rows ? outer_square(a) : multiply_transposed(a, a);
  return std::sqrt(std::max(symmetric_eigen(gram).values.back(), 0.0)) * (1 + 1e-10);
}

namespace {

template <class T>
std::vector<double> norms_of_columns(const DenseOf<T>& a) {
  std::vector<double> norms;
  for (int j = 0; j < a.columns; ++j) {
    double square = 0;
    for (int i = 0; i < a.rows; ++i) square += std::norm(a(i, j));
    norms.push_back(std::sqrt(square));
  }
  return norms;
}

} // namespace

std::vector<double> column_norms(const ComplexDense& a) { return norms_of_columns(a); }
std::vector<double> column_norms(const Dense& a) { return norms_of_columns(a); }

} // namespace flexgram
