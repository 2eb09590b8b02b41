#pragma once

#include <string>

namespace flexgram {

/// Takes kernels that fit this processor, where OpenBLAS does not know it: it falls back to those
/// of the oldest one then, without AVX (OpenBLAS 0.3.21 of Debian 12 on processors since 2023: a
/// fifth of the speed). A user's own OPENBLAS_CORETYPE wins; else that of the processes started
/// from here is set. Before other work.
void fit_blas_kernels();

/// Sets the threads of the BLAS that is loaded (OpenBLAS, MKL, BLIS); false if the
/// library is one without threads. A user's own OPENBLAS_NUM_THREADS, MKL_NUM_THREADS,
/// BLIS_NUM_THREADS or OMP_NUM_THREADS wins.
bool set_blas_threads(int threads);

/// Lets the BLAS take its buffers now where the address space is limited (ulimit -v):
/// OpenBLAS would wait for ever for them later, once other memory has used the limit up.
void reserve_blas_buffers();

/// What the BLAS says of itself, with the kernels it chose; "unknown" if it does not.
std::string blas_version();

} // namespace flexgram
