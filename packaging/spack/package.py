"""Spack recipe: copy this folder to var/spack/repos/builtin/packages/flexgram (or a repository of
your own). Written after Spack's documentation; not tried with Spack itself."""

from spack.package import *


class Flexgram(CMakePackage):
    """Reduction of elastic bodies of multibody systems with a proved error over a band."""

    maintainers("flexgram")
    license("BSD-2-Clause")

    version("main", branch="main")

    variant("python", default=True, description="the Python package, its verbs and its module")

    depends_on("c", type="build")
    depends_on("cxx", type="build")
    depends_on("cmake@3.22:", type="build")
    depends_on("pkgconfig", type="build")
    depends_on("mpi")
    depends_on("petsc@3.18:+mpi~complex+double")
    depends_on("slepc@3.18:")
    depends_on("mumps@5.5:+mpi+float+double+complex")
    depends_on("metis@5:")
    depends_on("hdf5@1.10:+mpi")
    depends_on("blas")
    depends_on("lapack")

    with when("+python"):
        extends("python@3.11:")
        depends_on("py-pybind11@2.10:", type="build")
        for package in ("numpy", "scipy", "h5py", "meshio", "pyyaml", "matplotlib", "mpi4py"):
            depends_on(f"py-{package}", type=("build", "run"))

    def cmake_args(self):
        return [
            self.define("FLEXGRAM_TESTS", False),
            self.define_from_variant("FLEXGRAM_PYTHON", "python"),
            self.define(
                "FLEXGRAM_PYTHON_PACKAGES", python_platlib if "+python" in self.spec else ""
            ),
        ]

    def setup_build_environment(self, env):
        for name in ("petsc", "slepc", "mumps", "metis"):
            env.set(f"{name.upper()}_DIR", self.spec[name].prefix)
