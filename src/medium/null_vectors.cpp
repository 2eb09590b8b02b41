#include "medium/null_vectors.hpp"

#include "base/text.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/sparse_product.hpp"
#include "medium/mode_search.hpp"
#include "model/rigid_body_modes.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

namespace {

/// Null vectors of K to the rounding of their entries: their exact image under K, and the
/// factor of K + sM, take away what is elastic in them. Vectors that K resists become shorter.
Block corrected(const CertifyRun& run, Block vectors) {
  const Dense one = identity(static_cast<int>(vectors.columns()));
  for (int step = 0; step < 2; ++step)
    add_product(vectors, -1.0,
                run.factors.solve(multiply_accurately(run.fom.K, vectors).product,
                                  ShiftedSolver::Verify::none),
                one);
  return vectors;
}

/// Of unit mass each.
Block normalised(const CertifyRun& run, Block vectors) {
  const Dense masses = inner(vectors, multiply(run.fom.M, vectors));
  std::vector<double> scales;
  for (int j = 0; j < masses.columns; ++j)
    scales.push_back(masses(j, j) > 0 ? 1 / std::sqrt(masses(j, j)) : 1.0);
  scale_columns(vectors, scales);
  return vectors;
}

/// The space again, null vectors of K among its rigid modes.
/// @param null, elastic  in the coordinates of its V.
std::unique_ptr<MediumSpace> space_with(const CertifyRun& run, const MediumSpace& space,
                                        const Dense& null, const Dense& elastic) {
  const int before = space.rigid();
  Block known;
  if (before > 0)
    known = combine(space.V(), first_columns(identity(space.columns()), before));
  Block rigid = orthonormalise(corrected(run, combine(space.V(), null)), known,
                               {run.fom.M, run.fom.K, 0}, 1e-12)
                    .vectors;
  Dense of_null = inner(rigid, multiply_accurately(run.fom.K, rigid).product);
  symmetrise(of_null);
  Dense stiffness(before + null.columns, before + null.columns);
  if (before > 0)
    set_part(stiffness, 0, 0, part_of(space.rigid_stiffness(), 0, before, 0, before));
  set_part(stiffness, before, before, of_null);
  Block rest = combine(space.V(), elastic); // Ritz vectors, which stay as they are
  add_product(rest, -1.0, rigid, inner(multiply(run.fom.M, rigid), rest));
  auto result = std::make_unique<MediumSpace>(run.fom, space.kappa(), space.tau());
  result->start_with_rigid_modes(before > 0 ? concatenate(known, rigid) : rigid.share(),
                                 std::move(stiffness), space.geometric());
  result->restore(std::move(rest));
  return result;
}

} // namespace

void take_out_null_vectors(const CertifyRun& run, ModalSpace& modal) {
  RitzPairs pairs = ritz_pairs(*modal.space);
  const auto slow_ones =
      std::lower_bound(pairs.lambda.begin(), pairs.lambda.end(), modal.slow()) -
      pairs.lambda.begin();
  const auto candidates =
      static_cast<int>(std::min<std::ptrdiff_t>(modal.elastic, slow_ones));
  modal.judged_elastic = candidates;
  if (candidates == 0) return;
  if (const auto negative =
          std::lower_bound(pairs.lambda.begin(), pairs.lambda.end(), -modal.slow()) -
          pairs.lambda.begin();
      negative > 0) {
    run.observer.fact(
        "unstable modes",
        text("%ld with negative stiffness, down to %.3g rad²/s² of the pencil "
             "K, M; slow ones are not taken for rigid",
             static_cast<long>(negative), pairs.lambda.front()));
    return;
  }
  run.factors.hold(1e-2 * modal.slow());
  for (int step = 0; step < 3; ++step) { // each divides what is elastic by λ_1/s
    const Block loads = multiply(
        run.fom.M, combine(modal.space->V(), first_columns(pairs.vectors, candidates)));
    modal.space->append(run.factors.solve(loads, ShiftedSolver::Verify::none), 1e-11);
    pairs = ritz_pairs(*modal.space);
  }
  const Dense slow = first_columns(pairs.vectors, candidates);
  const Block found = combine(modal.space->V(), slow);
  RigidSplit split = split_rigid(run.fom, found, true);
  // What other modes leave in a vector may hide that K holds nothing of it.
  if (split.count < candidates) {
    RigidSplit again =
        split_rigid(run.fom, normalised(run, corrected(run, copy(found))), true);
    if (again.count > split.count) split = std::move(again);
  }
  const int null = split.count;
  run.observer.fact("slow modes",
                    text("%d below %.3g Hz: %d of them rigid, by a factorisation of "
                         "K + sM (the body has no coordinates, or soft mounts)",
                         candidates, std::sqrt(modal.slow()) * hz, null));
  if (null == 0) return;
  Dense vectors = pairs.vectors;
  set_part(vectors, 0, 0, multiply(slow, split.rotation));
  const Dense all = orthonormal_columns(std::move(vectors));
  modal.space = space_with(run, *modal.space, first_columns(all, null),
                           part_of(all, 0, all.rows, null, all.columns - null));
  modal.judged_elastic -= null;
  modal.elastic -= null;
}

} // namespace flexgram
