#include "fem/condensation.hpp"

#include "base/error.hpp"
#include "linalg/decompositions.hpp"

namespace flexgram {
namespace {

/// K_aa⁻¹ Bᵀ.
Dense solved_internal(const Dense& K, int internal, Dense B) {
  const int n = K.rows - internal;
  Dense aa(internal, internal);
  for (int j = 0; j < internal; ++j)
    for (int i = 0; i < internal; ++i) aa(i, j) = K(n + i, n + j);
  if (cholesky(aa) != 0) throw Error("the incompatible modes have no stiffness");
  solve_right_transposed(aa, B); // B L⁻ᵀ
  return multiply(inverse_transposed(aa), transpose(B));
}

} // namespace

Dense condensed_stiffness(const Dense& K, int internal) {
  const int n = K.rows - internal;
  const Dense ua = part_of(K, 0, n, n, internal);
  Dense result = part_of(K, 0, n, 0, n);
  if (internal > 0) add_to(result, multiply(ua, solved_internal(K, internal, ua)), -1);
  symmetrise(result);
  return result;
}

Dense condensation(const Dense& K, int internal) {
  const int all = K.rows, n = all - internal;
  Dense ua = part_of(K, 0, n, n, internal);
  const Dense followed = solved_internal(K, internal, std::move(ua)); // K_aa⁻¹ K_au
  Dense T(all, n);
  for (int j = 0; j < n; ++j) {
    T(j, j) = 1;
    for (int i = 0; i < internal; ++i) T(n + i, j) = -followed(i, j);
  }
  return T;
}

Dense internal_response(const Dense& K, int internal, const Dense& load) {
  const int n = K.rows - internal;
  Dense f(1, internal);
  for (int i = 0; i < internal; ++i) f(0, i) = load(n + i, 0);
  const Dense a = solved_internal(K, internal, std::move(f));
  Dense result(K.rows, 1);
  for (int i = 0; i < internal; ++i) result(n + i, 0) = a(i, 0);
  return result;
}

Dense condensed(const Dense& a, const Dense& T) {
  Dense result = multiply_transposed(T, multiply(a, T));
  symmetrise(result);
  return result;
}

} // namespace flexgram
