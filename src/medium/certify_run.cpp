#include "medium/certify_run.hpp"

#include "base/process.hpp"

#include <algorithm>

namespace flexgram {

int CertifyRun::largest_order() const {
  if (spec.limit > 0) return spec.limit;
  return std::min(2000, columns_in_memory() / 3);
}

int CertifyRun::columns_in_memory() const {
  const double memory = 0.5 * available_memory_mb(fom.comm) * 1e6;
  const double each = 8.0 * static_cast<double>(std::max<PetscInt>(fom.rows.size(), 1));
  const double limit = std::min(memory / each, 3 * static_cast<double>(fom.n));
  return static_cast<int>(-max_over(fom.comm, -limit));
}

std::string CertifyRun::why_no_larger() const {
  if (spec.limit > 0) return "{medium_order}";
  return largest_order() < std::min<double>(2000.0, static_cast<double>(fom.n))
             ? "what the memory allows that is free"
             : "{medium_order} allows more";
}

} // namespace flexgram
