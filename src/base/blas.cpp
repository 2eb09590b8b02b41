#include "base/blas.hpp"

#include <dlfcn.h>
#include <sys/resource.h>

#include <cstdlib>
#include <string>
#include <vector>

namespace flexgram {
namespace {

/// A function of the libraries that are loaded; null: there is none.
template <class Function>
Function* loaded(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_DEFAULT, name));
}

} // namespace

void fit_blas_kernels() {
#ifdef __x86_64__
  const char* const variable = "OPENBLAS_CORETYPE";
  const auto core_name = loaded<char*()>("openblas_get_corename");
  // What OpenBLAS itself calls when it is loaded and unloaded.
  const auto forget = loaded<void()>("gotoblas_dynamic_quit");
  const auto choose = loaded<void()>("gotoblas_dynamic_init");
  if (std::getenv(variable) || !core_name || !forget || !choose) return;
  if (std::string(core_name()) != "Prescott" || !__builtin_cpu_supports("avx2") ||
      !__builtin_cpu_supports("fma"))
    return;
  const bool wide =
      __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  setenv(variable, wide ? "SkylakeX" : "Haswell", 1);
  forget();
  choose();
#endif
}

bool set_blas_threads(int threads) {
  for (const char* variable :
       {"OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "OMP_NUM_THREADS"})
    if (std::getenv(variable)) return true;
  for (const char* name :
       {"openblas_set_num_threads", "MKL_Set_Num_Threads", "bli_thread_set_num_threads"})
    if (void* symbol = dlsym(RTLD_DEFAULT, name)) {
      reinterpret_cast<void (*)(int)>(symbol)(threads);
      return true;
    }
  return false;
}

void reserve_blas_buffers() {
  rlimit limit{};
  void* symbol = dlsym(RTLD_DEFAULT, "dgemm_");
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY || !symbol)
    return;
  using Gemm = void (*)(const char*, const char*, const int*, const int*, const int*,
                        const double*, const double*, const int*, const double*,
                        const int*, const double*, double*, const int*);
  const int n = 256; // enough for every thread to take part
  const std::vector<double> a(n * n, 0.0);
  std::vector<double> c(n * n, 0.0);
  const double zero = 0;
  reinterpret_cast<Gemm>(symbol)("N", "N", &n, &n, &n, &zero, a.data(), &n, a.data(), &n,
                                 &zero, c.data(), &n);
}

std::string blas_version() {
  using Text = char* (*)();
  for (const char* name : {"openblas_get_config", "bli_info_get_version_str"})
    if (void* symbol = dlsym(RTLD_DEFAULT, name)) {
      std::string words = reinterpret_cast<Text>(symbol)();
      if (void* core = dlsym(RTLD_DEFAULT, "openblas_get_corename"))
        words += std::string(" on ") + reinterpret_cast<Text>(core)();
      return words;
    }
  return "unknown";
}

} // namespace flexgram
