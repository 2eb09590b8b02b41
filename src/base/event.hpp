#pragma once

#include "base/error.hpp"

#include <petscsys.h>

namespace flexgram {

/// A kind of work inside the stages, a line of -log_view: time, calls, balance of ranks.
class Event {
public:
  /// Registers `name` with PETSc at the first use.
  explicit Event(const char* name) : name_(name) {}

  /// The work lasts from here to the end of the scope.
  class Timed {
  public:
    explicit Timed(PetscLogEvent id) : id_(id) { PetscLogEventBegin(id_, 0, 0, 0, 0); }
    ~Timed() { PetscLogEventEnd(id_, 0, 0, 0, 0); }
    Timed(const Timed&) = delete;
    Timed& operator=(const Timed&) = delete;

  private:
    PetscLogEvent id_;
  };
  Timed timed() {
    if (id_ < 0) FG_CALL(PetscLogEventRegister(name_, PETSC_OBJECT_CLASSID, &id_));
    return Timed(id_);
  }

private:
  const char* name_;
  PetscLogEvent id_ = -1;
};

} // namespace flexgram
