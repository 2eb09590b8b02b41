#include "base/blas.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

namespace flexgram {
namespace {

/// A processor with AVX2 never runs the kernels of one without AVX, whatever OpenBLAS knows of it.
TEST(Blas, KernelsFitTheProcessor) {
#ifdef __x86_64__
  if (!__builtin_cpu_supports("avx2")) GTEST_SKIP() << "no AVX2";
  const char* const own = std::getenv("OPENBLAS_CORETYPE");
  const std::string kernels = blas_version();
  if (own && std::string(own) == "Prescott")
    EXPECT_NE(kernels.find("Prescott"), std::string::npos); // as the user wants
  else
    EXPECT_EQ(kernels.find("Prescott"), std::string::npos) << kernels;
#endif
}

} // namespace
} // namespace flexgram
