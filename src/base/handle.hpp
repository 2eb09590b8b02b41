#pragma once

#include "base/error.hpp"

#include <petscksp.h>
#include <petscmat.h>
#include <slepcbv.h>
#include <slepcsvd.h>

namespace flexgram {

namespace detail {
inline PetscErrorCode destroy(Mat* object) { return MatDestroy(object); }
inline PetscErrorCode destroy(Vec* object) { return VecDestroy(object); }
inline PetscErrorCode destroy(IS* object) { return ISDestroy(object); }
inline PetscErrorCode destroy(KSP* object) { return KSPDestroy(object); }
inline PetscErrorCode destroy(BV* object) { return BVDestroy(object); }
inline PetscErrorCode destroy(SVD* object) { return SVDDestroy(object); }
} // namespace detail

/// Owns one reference to a PETSc or SLEPc object. Move-only; `share()` takes a second
/// reference on purpose. `out()` is for creating calls: FG_CALL(MatCreate(comm,
/// K.out())).
template <class Object>
class Handle {
public:
  Handle() = default;
  Handle(Handle&& other) noexcept : object_(std::exchange(other.object_, nullptr)) {}
  Handle& operator=(Handle&& other) noexcept {
    std::swap(object_, other.object_);
    return *this;
  }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  ~Handle() { reset(); }

  /// Takes over the reference of `object`.
  static Handle adopt(Object object) {
    Handle handle;
    handle.object_ = object;
    return handle;
  }
  Handle share() const {
    if (object_) FG_CALL(PetscObjectReference(reinterpret_cast<PetscObject>(object_)));
    return adopt(object_);
  }
  void reset() noexcept {
    if (object_) detail::destroy(&object_);
    object_ = nullptr;
  }
  Object get() const { return object_; }
  operator Object() const { return object_; }
  explicit operator bool() const { return object_ != nullptr; }
  Object* out() {
    reset();
    return &object_;
  }

private:
  Object object_ = nullptr;
};

using Matrix = Handle<Mat>;

} // namespace flexgram
