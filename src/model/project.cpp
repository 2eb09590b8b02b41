#include "model/project.hpp"

#include "linalg/decompositions.hpp"
#include "linalg/sparse_product.hpp"
#include "model/dense_system.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

Dense reduce_matrix(Mat a, const Block& V, Symmetry of = Symmetry::symmetric) {
  Dense reduced = inner(V, multiply(a, V));
  symmetrise(reduced, of);
  return reduced;
}

} // namespace

SecondOrderModel project(const SecondOrderModel& fom, const Block& V) {
  DenseSystem system;
  system.K = reduce_matrix(fom.K, V);
  system.M = reduce_matrix(fom.M, V);
  for (const auto& [law, matrix] : fom.terms)
    system.terms.push_back({law, reduce_matrix(matrix, V, law.symmetry())});
  system.damping = fom.damping;
  system.B = inner(V, fom.B);
  system.C = fom.outputs_are_inputs ? system.B : inner(V, fom.C);
  system.outputs_are_inputs = fom.outputs_are_inputs;
  return system.model(fom);
}

std::vector<double> eigenfrequencies(const SecondOrderModel& dense) {
  Dense l = to_dense(dense.M);
  if (cholesky(l) != 0) return {};
  std::vector<double> omega =
      symmetric_eigen(to_dense(dense.K), to_dense(dense.M)).values;
  for (double& value : omega) value = std::sqrt(std::max(value, 0.0));
  return omega;
}

double relative_smallest_eigenvalue(Mat dense) {
  const auto values = symmetric_eigen(to_dense(dense)).values;
  return values.back() != 0 ? values.front() / values.back()
                            : 0.0; // 0: a body of rigid modes
}

double relative_error(const ComplexDense& h, const ComplexDense& h_r) {
  ComplexDense difference = h;
  for (std::size_t i = 0; i < h.data.size(); ++i) difference.data[i] -= h_r.data[i];
  return frobenius_norm(difference) / frobenius_norm(h);
}

} // namespace flexgram
