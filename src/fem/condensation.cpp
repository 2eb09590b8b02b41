#include "fem/condensation.hpp"

#include "base/error.hpp"
#include "linalg/decompositions.hpp"

namespace flexgram {

Dense condensation(const Dense& K, int internal) {
  const int all = K.rows, n = all - internal;
  Dense aa(internal, internal), ua(n, internal);
  for (int j = 0; j < internal; ++j) {
    for (int i = 0; i < internal; ++i) aa(i, j) = K(n + i, n + j);
    for (int i = 0; i < n; ++i) ua(i, j) = K(i, n + j);
  }
  if (cholesky(aa) != 0) throw Error("the incompatible modes have no stiffness");
  solve_right_transposed(aa, ua);                                         // K_ua L⁻ᵀ
  const Dense followed = multiply(inverse_transposed(aa), transpose(ua)); // K_aa⁻¹ K_au
  Dense T(all, n);
  for (int j = 0; j < n; ++j) {
    T(j, j) = 1;
    for (int i = 0; i < internal; ++i) T(n + i, j) = -followed(i, j);
  }
  return T;
}

Dense condensed(const Dense& a, const Dense& T) {
  Dense result = multiply_transposed(T, multiply(a, T));
  symmetrise(result);
  return result;
}

} // namespace flexgram
