#include "linalg/last_turn.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {

LastTurn last_turn(const Dense& K, const Dense& M) {
  constexpr double largest = 1e-6, epsilon = std::numeric_limits<double>::epsilon();
  const int n = K.columns;
  LastTurn turn{Dense(n, n), Dense(n, n), Dense(n, n)};
  Dense beside_K(n, n), beside_M(n, n), first_K(n, n), first_M(n, n), Z(n, n);
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < j; ++i) {
      const double k = K(i, j), m = M(i, j),
                   apart = K(i, i) * M(j, j) - M(i, i) * K(j, j),
                   z_ij = (m * K(j, j) - k * M(j, j)) / apart,
                   z_ji = (k * M(i, i) - m * K(i, i)) / apart;
      const bool taken = std::max(std::abs(z_ij), std::abs(z_ji)) <= largest; // not NaN
      const auto left = [&](const Dense& A, double beside) {
        return taken ? 4 * epsilon *
                           (std::abs(beside) + std::abs(A(i, i) * z_ij) +
                            std::abs(A(j, j) * z_ji))
                     : std::abs(beside);
      };
      first_K(i, j) = first_K(j, i) = left(K, k);
      first_M(i, j) = first_M(j, i) = left(M, m);
      beside_K(i, j) = beside_K(j, i) = std::abs(k);
      beside_M(i, j) = beside_M(j, i) = std::abs(m);
      if (!taken) continue;
      turn.Z(i, j) = z_ij, turn.Z(j, i) = z_ji;
      Z(i, j) = std::abs(z_ij), Z(j, i) = std::abs(z_ji);
    }
  // (I + Z)ᵀA(I + Z) beside first order: ZᵀAZ and, beside the diagonal of A, ZᵀA + AZ.
  const auto with_second_order = [&](const Dense& A, const Dense& beside, Dense rest) {
    Dense AZ = multiply(beside, Z), all = AZ;
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) all(i, j) += std::abs(A(i, i)) * Z(i, j);
    const Dense squares = multiply_transposed(Z, all);
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i)
        rest(i, j) += 1.001 * (AZ(i, j) + AZ(j, i) + squares(i, j));
    return rest;
  };
  turn.rest_K = with_second_order(K, beside_K, std::move(first_K));
  turn.rest_M = with_second_order(M, beside_M, std::move(first_M));
  return turn;
}

} // namespace flexgram
