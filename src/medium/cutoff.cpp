#include "medium/cutoff.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/orthonormal.hpp"
#include "linalg/sparse.hpp"
#include "linalg/sparse_product.hpp"
#include "medium/checkpoint.hpp"
#include "model/checks.hpp"
#include "model/rigid_body_modes.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

namespace {

/// Dofs that by themselves would vibrate a million times faster than ω: as good as
/// massless.
bool has_light_dofs(const SecondOrderModel& fom, double omega) {
  const auto k = diagonal(fom.K), m = diagonal(fom.M);
  double fastest = 0;
  for (std::size_t i = 0; i < k.size(); ++i)
    if (k[i] > 0) fastest = std::max(fastest, m[i] > 0 ? k[i] / m[i] : HUGE_VAL);
  return max_over(fom.comm, fastest) > 1e12 * omega * omega;
}

/// The loads of few ports with random ones beside them, if there are modes to be found:
/// blocks of some width cost little more than narrow ones, and hundreds of modes would
/// take as many Krylov steps.
Block with_company(const SecondOrderModel& fom, const Block& loads, int modes) {
  const int width = std::clamp(modes / 10, 8, wide_block);
  const int more = std::min(modes, width) - static_cast<int>(loads.columns());
  return more > 0 ? concatenate(loads, multiply(fom.M, random_block(fom.B, more, 99)))
                  : loads.share();
}

/// Equal ports are answered once.
Block response_to_ports(const CertifyRun& run, const PortLoads& ports,
                        const Block& balanced, int modes) {
  std::vector<int> alone, place(ports.same_as.size());
  for (int j = 0; j < ports.count(); ++j) {
    const auto at = as_size(j);
    place[at] = ports.is_first(j) ? static_cast<int>(alone.size())
                                  : place[as_size(ports.same_as[at])];
    if (ports.is_first(j)) alone.push_back(j);
  }
  Block response =
      run.factors.solve(with_company(run.fom, select_columns(balanced, alone), modes));
  if (alone.size() == place.size()) return response;
  for (auto j = static_cast<int>(alone.size()); j < response.columns(); ++j)
    place.push_back(j);
  return select_columns(response, place);
}

/// zᵀMz = 1/(1 + κλ) of the Ritz vectors in the span of a response, ascending.
std::vector<double> mass_shares(const SecondOrderModel& fom, const Block& response,
                                double kappa, bool is_rigid) {
  const Block Z =
      orthonormalise(copy(response), Block(), {fom.M, fom.K, kappa}, 1e-7).vectors;
  Dense m = inner(Z, multiply(fom.M, Z));
  symmetrise(m);
  auto eigen = symmetric_eigen(m);
  share_from_first(fom.comm, eigen.values);
  if (eigen.values.empty() && !is_rigid)
    throw Error("the ports move nothing, or so little that doubles cannot square it: "
                "are the units of B and C right?");
  return eigen.values;
}

} // namespace

Cutoff choose_cutoff(const CertifyRun& run, const PortLoads& ports, const Block& balanced,
                     int rigid, double omega, bool mass_is_singular) {
  const int modes_wanted = run.spec.modes;
  constexpr double beside = 1.0123; // where the shift hits a mode
  int last_null = 0;                // pivots without size at the cutoff before
  for (int attempt = 0; attempt < 12; ++attempt) {
    run.checkpoints.end_if_asked("the first factorisation");
    with_context(text("factorising K - ω²M at the cutoff, %g Hz", omega * hz),
                 [&] { run.factors.hold(-omega * omega); });
    const int below = run.factors.negative(), null = run.factors.null();
    if (below < modes_wanted) {
      omega *= std::min(3.0, 1.1 * std::sqrt((modes_wanted + 2.0) / std::max(below, 1)));
      continue;
    }
    if (null > 0 && last_null > 0) // no eigenvalues: they are there at two shifts
      throw Error(words_of_shared_null_vectors(null));
    last_null = null;
    if (null == 0) try {
        // M + κK is positive wherever K + τM is.
        const double kappa = 1 / std::max(omega * omega, 2 * run.tau);
        Block response = response_to_ports(run, ports, balanced, below - rigid);
        // A body that rigid interfaces hold as a whole has rigid modes and nothing else.
        const bool is_rigid = run.fom.n == rigid;
        const std::vector<double> shares =
            mass_shares(run.fom, response, kappa, is_rigid);
        // λ = ω_c² to many digits: the shift hits a mode.
        if (std::all_of(shares.begin(), shares.end(), [&](double m) {
              return std::abs((1 + kappa * omega * omega) * m - 1) > 1e-7;
            })) {
          mass_is_singular =
              mass_is_singular || has_light_dofs(run.fom, omega) ||
              (!shares.empty() &&
               shares.front() * 1e3 * eigenvalue_scale(run.fom) * kappa < 1);
          run.observer.fact("inner product",
                            mass_is_singular ? "M + K/ω_c² (M is singular)" : "M");
          return {omega, below, mass_is_singular ? kappa : 0, std::move(response)};
        }
      } catch (const ShiftError&) { // beside it
      }
    omega *= beside;
  }
  throw Error(text("no cutoff was found with %d modes below and no eigenvalue near",
                   modes_wanted));
}

} // namespace flexgram
