/// modal: eigenmodes of the body with free interfaces, lowest first: modal truncation, with
/// which the paper compares (Fehr, Eberhard, Lehner, section 3).

#include "basis/method.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>

namespace flexgram {
namespace {

Candidate make(const SecondStage& stage) {
  // The Ritz vectors of the whole medium space are better than those the search ended
  // with.
  const Elastic e(stage);
  const Dense modes =
      first_columns(e.response.U(), static_cast<int>(stage.medium.lambda.size()));
  return nested(after_rigid(orthonormal_columns(modes), e.rigid, e.N),
                std::max(1, e.rigid));
}

int modes_in_band(const Candidate&, const SecondStage& stage) {
  const double last = stage.bands.back().omega.back();
  int count = stage.medium.rigid;
  for (double l : stage.medium.lambda) count += l <= last * last;
  return std::max(count, 1);
}

Demand all_of_them(int order, const std::vector<double>&) {
  return {std::max(order, 1), 0};
}

} // namespace

extern const Method modal_method;
const Method modal_method{"lowest eigenmodes", make, modes_in_band, all_of_them};

} // namespace flexgram
