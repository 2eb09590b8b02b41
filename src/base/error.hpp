#pragma once

#include <petscsys.h>

#include <stdexcept>
#include <string>
#include <utility>

namespace flexgram {

/// Every failure that a user can meet. The message names the file, dataset or value and
/// what was expected. Contexts are added on the way up: "while factorising shift 3 of 5:
/// ...".
class Error : public std::exception {
public:
  explicit Error(std::string message) : message_(std::move(message)) {}
  const char* what() const noexcept override { return message_.c_str(); }
  void add_context(const std::string& context) { message_ = context + ": " + message_; }

private:
  std::string message_;
};

/// A factorisation failed because the shifted matrix is (numerically) singular.
class ShiftError : public Error {
  using Error::Error;
};

/// The work does not fit into the memory that the run may use.
class MemoryError : public Error {
  using Error::Error;
};

inline constexpr const char* out_of_memory =
    "out of memory: use more ranks or fewer groups (flexgram plan tells the need)";

/// The run was asked to end; what is finished is in a checkpoint.
class Interrupted : public Error {
  using Error::Error;
};

/// Runs `work` and adds `context` to any Error that leaves it; the type is kept.
template <class Work>
decltype(auto) with_context(const std::string& context, Work&& work) {
  try {
    return std::forward<Work>(work)();
  } catch (Error& error) {
    error.add_context(context);
    throw;
  }
}

/// "flexgram: message" on stderr, by one write: of a line in pieces (printf of newer C
/// libraries writes 128 bytes at a time) Open MPI 5's mpirun lost the first now and then.
void tell_error(const std::string& message);

/// Lets PETSc hand its messages to us instead of printing a stack.
void install_petsc_error_handler();

/// Throws an Error that carries PETSc's own text for the error that just happened.
[[noreturn]] void throw_petsc_error(PetscErrorCode code, const char* call);

} // namespace flexgram

/// Calls a PETSc, SLEPc or MPI-returning-PETSc function and throws on a nonzero code.
#define FG_CALL(call)                                                                    \
  do {                                                                                   \
    const PetscErrorCode fg_code_ = (call);                                              \
    if (fg_code_) ::flexgram::throw_petsc_error(fg_code_, #call);                        \
  } while (false)
