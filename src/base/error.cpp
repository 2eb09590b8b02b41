#include "base/error.hpp"

#include "base/text.hpp"

#include <cstdio>

namespace flexgram {
namespace {

std::string& last_message() {
  static std::string message;
  return message;
}

PetscErrorCode& first_code() {
  static auto code = static_cast<PetscErrorCode>(0);
  return code;
}

PetscErrorCode remember(MPI_Comm, int, const char* function, const char*,
                        PetscErrorCode code, PetscErrorType type, const char* message,
                        void*) {
  if (type == PETSC_ERROR_INITIAL) first_code() = code;
  if (type == PETSC_ERROR_INITIAL)
    last_message() = text("%s (%s)", message ? message : "error", function);
  return code;
}

} // namespace

void tell_error(const std::string& message) {
  const std::string line = "flexgram: " + message + "\n";
  std::fwrite(line.data(), 1, line.size(), stderr);
  std::fflush(stderr);
}

void install_petsc_error_handler() { PetscPushErrorHandler(remember, nullptr); }

void throw_petsc_error(PetscErrorCode code, const char* call) {
  std::string message = std::exchange(last_message(), {});
  if (std::exchange(first_code(), static_cast<PetscErrorCode>(0)) == PETSC_ERR_MEM)
    throw MemoryError(out_of_memory);
  if (message.empty()) {
    const char* generic = nullptr;
    PetscErrorMessage(code, &generic, nullptr);
    message = generic ? generic : "unknown error";
  }
  const std::string name(call, std::string(call).find('('));
  throw Error(text("PETSc error %d in %s: %s", static_cast<int>(code), name.c_str(),
                   message.c_str()));
}

} // namespace flexgram
