#include "reduce/project.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

Dense reduce_matrix(Mat a, const Block& V) {
  Dense reduced = inner(V, multiply(a, V));
  symmetrise(reduced);
  return reduced;
}

Block whole(const Dense& a) {
  Block block(PETSC_COMM_SELF, {0, a.rows}, a.rows, a.columns);
  std::copy(a.data.begin(), a.data.end(), Block::Access(block).all().begin());
  return block;
}

} // namespace

SecondOrderModel project(const SecondOrderModel& fom, const Block& V) {
  SecondOrderModel rom;
  rom.name = fom.name;
  rom.comm = PETSC_COMM_SELF;
  rom.n = V.columns();
  rom.rows = {0, rom.n};
  const Dense K = reduce_matrix(fom.K, V), M = reduce_matrix(fom.M, V);
  Dense D = fom.D ? reduce_matrix(fom.D, V) : Dense(K.rows, K.columns);
  for (std::size_t i = 0; i < D.data.size(); ++i)
    D.data[i] += fom.damping.alpha * M.data[i] + fom.damping.beta * K.data[i];
  rom.K = make_dense(K);
  rom.M = make_dense(M);
  if (frobenius_norm(D) > 0) rom.D = make_dense(D);
  rom.damping.eta = fom.damping.eta;
  rom.B = whole(inner(V, fom.B));
  rom.C = fom.outputs_are_inputs ? rom.B.share() : whole(inner(V, fom.C));
  rom.outputs_are_inputs = fom.outputs_are_inputs;
  rom.inputs = fom.inputs;
  rom.outputs = fom.outputs;
  return rom;
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
  return values.front() / values.back();
}

double relative_error(const ComplexDense& h, const ComplexDense& h_r) {
  ComplexDense difference = h;
  for (std::size_t i = 0; i < h.data.size(); ++i) difference.data[i] -= h_r.data[i];
  return frobenius_norm(difference) / frobenius_norm(h);
}

} // namespace flexgram
