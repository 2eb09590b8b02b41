#include "base/blas.hpp"
#include "base/error.hpp"
#include "base/parallel.hpp"

#include <gtest/gtest.h>
#include <slepcsys.h>

/// Every rank runs every test; only rank 0 reports, and one failing rank fails the run.
int main(int argc, char** argv) {
  flexgram::fit_blas_kernels();
  ::testing::InitGoogleTest(&argc, argv);
  SlepcInitialize(&argc, &argv, nullptr, nullptr);
  flexgram::install_petsc_error_handler();
  const int rank = flexgram::comm_rank(PETSC_COMM_WORLD);
  auto& listeners = ::testing::UnitTest::GetInstance()->listeners();
  if (rank != 0) {
    class Failures : public ::testing::EmptyTestEventListener {
      void OnTestPartResult(const ::testing::TestPartResult& result) override {
        if (result.failed())
          std::fprintf(stderr, "rank > 0: %s:%d: %s\n", result.file_name(),
                       result.line_number(), result.summary());
      }
    };
    delete listeners.Release(listeners.default_result_printer());
    listeners.Append(new Failures);
  }
  int status = RUN_ALL_TESTS();
  if (::testing::UnitTest::GetInstance()->test_to_run_count() == 0) status = 1;
  MPI_Allreduce(MPI_IN_PLACE, &status, 1, MPI_INT, MPI_MAX, PETSC_COMM_WORLD);
  SlepcFinalize();
  return status;
}
