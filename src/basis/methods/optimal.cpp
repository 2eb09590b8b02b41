/// optimal: the basis of given order whose largest error over the band is smallest.
///
/// Minimised is the q-norm over the frequencies of ‖H − H_V‖²_F/‖H‖²_F, q = 2, 8, 32, by
/// L-BFGS from the better one of the Gramian's bases; the largest over H as a whole and
/// the kinds of ports that the tolerance holds for. With X = (VᵀAV)⁻¹VᵀB, Z =
/// (VᵀAV)⁻¹VᵀC, R_B = B − AVX, R_C = C − AVZ and E = H − CᵀVX
///   d‖E‖² = −2 Re tr(dVᵀ (R_C Ē Xᵀ + R_B Eᴴ Zᵀ)),
/// so an evaluation is some products of the size of V times the responses. A local
/// minimum, not proved to be the global one; its error is certified like any other.

#include "base/index.hpp"
#include "basis/method.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/lbfgs.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace flexgram {
namespace {

using Complex = std::complex<double>;
/// The tolerance is met with a margin for what lies between the frequencies.
constexpr double margin = 0.95;
/// Errors below this are rounding.
constexpr double exact = 1e-11;

/// Responses at all frequencies side by side: N × (ports · frequencies), real and
/// imaginary part.
struct Responses {
  Responses(int rows, int columns) : re(rows, columns), im(rows, columns) {}
  Dense re, im;
};

/// The error of a basis over a grid of frequencies, in coordinates where the elastic part
/// of the medium model is diagonal.
class BandError {
public:
  BandError(const SecondStage& stage, std::vector<double> omega);

  int rigid() const { return e_.rigid; }
  int elastic() const { return e_.count; }
  /// Elastic columns of a basis in these coordinates, and back.
  Dense coordinates(const Dense& basis) const;
  Dense basis(const Dense& elastic) const;

  /// Relative errors, squared, by frequency and view; the gradient of Σ weight · error
  /// for weights that `weigh` makes of them.
  using Weigh = std::function<std::vector<double>(const std::vector<double>&)>;
  std::vector<double> errors(const Dense& V, const Weigh* weigh, Dense* gradient) const;

private:
  /// Of A(ω), or of A(ω)ᵀ.
  enum class Side { inputs, outputs };
  Responses small_response(const Dense& V, const Dense& loads, Side side) const;
  Responses residual(const Dense& V, const Responses& x, const Dense& loads,
                     Side side) const;

  Elastic e_;
  const MediumModel& medium_;
  std::vector<double> omega_;
  Dense K_, M_, B_, C_; ///< of the whole medium model, rigid modes first
  std::vector<Term<Dense>> terms_;
  std::vector<ComplexDense> H_;
  std::vector<double> size_; ///< ‖H‖² by frequency and view
};

BandError::BandError(const SecondStage& stage, std::vector<double> omega)
    : e_(stage), medium_(stage.medium), omega_(std::move(omega)) {
  const int N = e_.N, r = e_.rigid;
  Dense T = identity(N);
  set_part(T, r, r, e_.response.U());
  const DenseSystem system = medium_.system.project(T);
  K_ = system.K;
  M_ = system.M;
  terms_ = system.terms;
  B_ = system.B;
  C_ = system.C;
  const DenseResponse response(medium_.system, medium_.tau);
  for (double w : omega_) {
    H_.push_back(response.transfer(w));
    for (const ViewNorms& size : medium_.at(w, 0).size)
      size_.push_back(size.at[0] * size.at[0]);
  }
  if (stage.relative_to == RelativeTo::band)
    for (std::size_t v = 0; v < medium_.views.size(); ++v) {
      double largest = 0;
      for (std::size_t i = v; i < size_.size(); i += medium_.views.size())
        largest = std::max(largest, size_[i]);
      for (std::size_t i = v; i < size_.size(); i += medium_.views.size())
        size_[i] = largest;
    }
}

Dense BandError::coordinates(const Dense& basis) const {
  // U is (K + τM)-orthonormal: its inverse is Uᵀ(K + τM).
  Dense E = e_.system.K;
  add_to(E, e_.system.M, medium_.tau);
  const Dense elastic =
      part_of(basis, e_.rigid, e_.count, e_.rigid, basis.columns - e_.rigid);
  return orthonormal_columns(multiply_transposed(e_.response.U(), multiply(E, elastic)));
}

Dense BandError::basis(const Dense& elastic) const {
  return after_rigid(orthonormal_columns(multiply(e_.response.U(), elastic)), e_.rigid,
                     e_.N);
}

/// (VᵀAV)⁻¹VᵀP at all frequencies.
Responses BandError::small_response(const Dense& V, const Dense& loads, Side side) const {
  DenseSystem system;
  system.M = M_;
  system.K = K_;
  system.terms = terms_;
  system.B = system.C = loads;
  system.damping = medium_.system.damping;
  system = system.project(V);
  const DenseResponse small(side == Side::inputs ? system : system.transposed(),
                            medium_.tau);
  const int m = V.columns, p = loads.columns;
  Responses x(m, p * static_cast<int>(omega_.size()));
  for (std::size_t l = 0; l < omega_.size(); ++l) {
    const ComplexDense modal = small.modal_response(omega_[l]);
    const std::size_t first = l * modal.data.size();
    for (std::size_t i = 0; i < modal.data.size(); ++i) {
      x.re.data[first + i] = modal.data[i].real();
      x.im.data[first + i] = modal.data[i].imag();
    }
  }
  x.re = multiply(small.U(), x.re);
  x.im = multiply(small.U(), x.im);
  return x;
}

/// P − A V x at all frequencies.
Responses BandError::residual(const Dense& V, const Responses& x, const Dense& loads,
                              Side side) const {
  Responses r(V.rows, x.re.columns);
  const int p = loads.columns, N = V.rows;
  const Dense re = multiply(V, x.re), im = multiply(V, x.im);
  std::vector<Dense> T_re, T_im;
  for (const auto& [law, T] : terms_) {
    T_re.push_back(multiply(T, re));
    T_im.push_back(multiply(T, im));
  }
  for (std::size_t l = 0; l < omega_.size(); ++l) {
    ShiftCoefficients c = medium_.system.coefficients(omega_[l]);
    if (side == Side::outputs) c.terms = transposed(std::move(c.terms), terms_);
    for (int j = 0; j < p; ++j) {
      const int at = static_cast<int>(l) * p + j;
      for (int i = 0; i < N; ++i) { // K and M are diagonal here
        const Complex a = c.k * K_(i, i) + c.m * M_(i, i);
        r.re(i, at) = loads(i, j) - a.real() * re(i, at) + a.imag() * im(i, at);
        r.im(i, at) = -a.real() * im(i, at) - a.imag() * re(i, at);
        for (std::size_t t = 0; t < terms_.size(); ++t) {
          const Complex g = c.terms[t];
          r.re(i, at) -= g.real() * T_re[t](i, at) - g.imag() * T_im[t](i, at);
          r.im(i, at) -= g.imag() * T_re[t](i, at) + g.real() * T_im[t](i, at);
        }
      }
    }
  }
  return r;
}

/// G ← G + Re Σ_l R_l F_l Y_lᵀ.
void add_products(Dense& G, const Responses& R, const std::vector<ComplexDense>& F,
                  const Responses& Y) {
  const int p = F.front().columns, q = F.front().rows, N = R.re.rows;
  Responses RF(N, p * static_cast<int>(F.size()));
  for (std::size_t l = 0; l < F.size(); ++l) {
    Dense f_re(q, p), f_im(q, p);
    for (std::size_t i = 0; i < f_re.data.size(); ++i) {
      f_re.data[i] = F[l].data[i].real();
      f_im.data[i] = F[l].data[i].imag();
    }
    const int from = static_cast<int>(l) * q, to = static_cast<int>(l) * p;
    const Dense re = part_of(R.re, 0, N, from, q), im = part_of(R.im, 0, N, from, q);
    const Dense rr = multiply(re, f_re), ii = multiply(im, f_im), ri = multiply(re, f_im),
                ir = multiply(im, f_re);
    for (std::size_t i = 0; i < rr.data.size(); ++i) {
      const std::size_t at = as_size(to) * as_size(N) + i;
      RF.re.data[at] = rr.data[i] - ii.data[i];
      RF.im.data[at] = ri.data[i] + ir.data[i];
    }
  }
  const Dense re = multiply(RF.re, transpose(Y.re)),
              im = multiply(RF.im, transpose(Y.im));
  for (std::size_t i = 0; i < G.data.size(); ++i) G.data[i] += re.data[i] - im.data[i];
}

std::vector<double> BandError::errors(const Dense& elastic, const Weigh* weigh,
                                      Dense* gradient) const {
  const Dense V = after_rigid(elastic, e_.rigid, e_.N);
  const bool same = medium_.system.outputs_are_inputs && is_symmetric(terms_);
  const Responses X = small_response(V, B_, Side::inputs);
  const Dense VC = multiply_transposed(C_, V); // CᵀV
  const Dense h_re = multiply(VC, X.re), h_im = multiply(VC, X.im);
  const std::size_t views = medium_.views.size();
  const int p = B_.columns, q = C_.columns;
  std::vector<ComplexDense> E = H_;
  std::vector<double> errors;
  for (std::size_t l = 0; l < omega_.size(); ++l) {
    for (int j = 0; j < p; ++j)
      for (int i = 0; i < q; ++i) {
        const int at = static_cast<int>(l) * p + j;
        E[l](i, j) -= Complex(h_re(i, at), h_im(i, at));
      }
    for (std::size_t v = 0; v < views; ++v) {
      double square = 0;
      for (int j : medium_.views[v].columns)
        for (int i : medium_.views[v].rows) square += std::norm(E[l](i, j));
      errors.push_back(square / size_[l * views + v]);
    }
  }
  if (!gradient) return errors;

  // E weighted: Σ over the views of weight/‖H‖² times the view's block.
  const std::vector<double> weight = (*weigh)(errors);
  std::vector<ComplexDense> conjugated, adjoint;
  for (std::size_t l = 0; l < omega_.size(); ++l) {
    ComplexDense W(q, p), WH(p, q);
    for (std::size_t v = 0; v < views; ++v)
      for (int j : medium_.views[v].columns)
        for (int i : medium_.views[v].rows)
          W(i, j) += weight[l * views + v] / size_[l * views + v] * std::conj(E[l](i, j));
    for (int j = 0; j < p; ++j)
      for (int i = 0; i < q; ++i) WH(j, i) = W(i, j);
    conjugated.push_back(std::move(W));
    adjoint.push_back(std::move(WH));
  }
  Dense G(V.rows, V.columns);
  const Responses R_B = residual(V, X, B_, Side::inputs);
  if (same) { // E is symmetric: both parts are alike
    add_products(G, R_B, conjugated, X);
    for (double& g : G.data) g *= -4;
  } else {
    const Responses Z = small_response(V, C_, Side::outputs);
    add_products(G, residual(V, Z, C_, Side::outputs), conjugated, X);
    add_products(G, R_B, adjoint, Z);
    for (double& g : G.data) g *= -2;
  }
  *gradient = part_of(G, e_.rigid, e_.count, e_.rigid, elastic.columns);
  return errors;
}

double worst_of(const std::vector<double>& errors) {
  double worst = 0;
  for (double e : errors) worst = std::max(worst, std::isfinite(e) ? e : HUGE_VAL);
  return std::sqrt(worst);
}

/// V moved to a minimum of the logarithm of the q-norm of the errors, which is no smaller
/// than the largest of them; or until that is within the tolerance.
Dense minimum(const BandError& band, Dense V, double q, double tolerance) {
  const Objective f = [&](const std::vector<double>& x, std::vector<double>& g) {
    Dense at(V.rows, V.columns), slope;
    at.data = x;
    double sum = 0, largest = 0; // scaled by the largest, so that nothing overflows
    const BandError::Weigh weigh = [&](const std::vector<double>& e) {
      largest = *std::max_element(e.begin(), e.end());
      std::vector<double> weight;
      for (double one : e) sum += std::pow(one / largest, q);
      for (double one : e)
        weight.push_back(std::pow(one / largest, q - 1) / (sum * largest));
      return weight;
    };
    band.errors(at, &weigh, &slope);
    g = slope.data;
    return std::log(largest) + std::log(sum) / q;
  };
  std::vector<double> x = V.data;
  LbfgsOptions options;
  if (tolerance > 0) options.enough = 2 * std::log(margin * tolerance);
  minimise(f, x, options);
  V.data = std::move(x);
  return orthonormal_columns(std::move(V));
}

std::vector<double> grid_of(const SecondStage& stage, int count) {
  std::vector<Interval> bands;
  for (const BandWeight& band : stage.bands)
    bands.push_back({band.omega.front(), band.omega.back()});
  return band_grid(bands, count, stage.medium.resonances);
}

/// Optimises over a coarse grid, which gains the frequencies where a fine one shows more.
class Optimum {
public:
  explicit Optimum(const SecondStage& stage)
      : stage_(stage), fine_(grid_of(stage, 300)), check_(stage, fine_) {
    for (const char* name : {"gramian", "weighted"})
      starts.push_back(make_candidate(name, stage));
  }

  Dense basis(int m) {
    Dense best;
    double least = HUGE_VAL;
    const auto offer = [&](const Dense& V) {
      const double worst = worst_of(check_.errors(V, nullptr, nullptr));
      if (best.columns > 0 && !(worst < least)) return;
      best = V;
      least = worst;
    };
    for (const Candidate& from : starts) offer(check_.coordinates(from.basis(m)));
    Dense V = best;
    std::vector<double> omega = grid_of(stage_, 40);
    auto band = std::make_unique<BandError>(stage_, omega);
    const auto done = [&] { return least <= std::max(margin * stage_.tolerance, exact); };
    for (const double q : {2.0, 8.0, 32.0})
      if (!done()) offer(V = minimum(*band, std::move(V), q, stage_.tolerance));
    for (int round = 0; round < 2 && !done(); ++round) {
      const double known = worst_of(band->errors(V, nullptr, nullptr));
      const auto errors = check_.errors(V, nullptr, nullptr);
      if (worst_of(errors) < 1.02 * known) break;
      const std::size_t views = errors.size() / fine_.size();
      for (std::size_t i = 0; i < errors.size(); ++i)
        if (std::sqrt(errors[i]) > 0.9 * known) omega.push_back(fine_[i / views]);
      std::sort(omega.begin(), omega.end());
      omega.erase(std::unique(omega.begin(), omega.end()), omega.end());
      band = std::make_unique<BandError>(stage_, omega);
      offer(V = minimum(*band, std::move(V), 32.0, stage_.tolerance));
    }
    return check_.basis(best);
  }

  std::vector<Candidate> starts;

private:
  const SecondStage stage_;
  std::vector<double> fine_;
  BandError check_;
};

Candidate make(const SecondStage& stage) {
  const auto optimum = std::make_shared<Optimum>(stage);
  const auto found = std::make_shared<std::map<int, Dense>>(); // each costs seconds
  Candidate c;
  c.least = stage.medium.rigid + 1;
  c.most = stage.medium.system.order();
  for (const Candidate& start : optimum->starts) c.most = std::min(c.most, start.most);
  c.sigma = optimum->starts.front().sigma;
  c.no_fewer = std::make_shared<Candidate>(optimum->starts.front());
  c.basis = [optimum, found](int m) {
    const auto known = found->find(m);
    return known != found->end() ? known->second : (*found)[m] = optimum->basis(m);
  };
  return c;
}

} // namespace

extern const Method optimal_method;
const Method optimal_method{
    "the largest error over the band minimised at its order (locally), in seconds", make};

} // namespace flexgram
