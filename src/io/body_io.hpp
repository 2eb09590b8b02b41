#pragma once

#include "io/hdf5_file.hpp"
#include "model/second_order_model.hpp"

namespace flexgram {

/// True if the file describes a mesh to assemble, false if it holds matrices.
bool holds_mesh(const Hdf5File& file);

/// Reads a body of matrices: sparse /K, /M, optional /D in the layout of MATLAB v7.3
/// (data, ir, jc), /B, optional /C dense or sparse, α, β, η, dof map, port names. Each
/// rank reads its rows. Checks shapes, index ranges, NaN and Inf, symmetry of K, M, D (a
/// skew part is gyroscopic or circulatory and is refused), and finds α and β in a
/// proportional D.
/// @throws Error naming file, dataset, place and what was expected. Collective on
/// file.comm().
SecondOrderModel read_body(const Hdf5File& file);

/// What of the file's root is not read, in words with the names that are: a misspelt
/// /Damping must not pass for a body without. Empty if all is read. Rank-local.
std::string not_read(const Hdf5File& file);

/// Replaces `matrix` (called `name`) by its symmetric part, which is what is reduced and
/// certified; matrices that are symmetric stay as they are.
/// @param remarks  gains a line with the size of the skew part, if there was one.
/// @throws Error with the worst pair of entries if that is more than 1e-10 of the largest
/// entry. Collective.
void take_symmetric_part(Matrix& matrix, const std::string& name,
                         const std::string& source, std::vector<std::string>& remarks);

/// The stiffness; its skew part, if it is more than rounding, is a term, circulatory forces.
/// @throws Error if one triangle is missing. Collective.
void set_stiffness(SecondOrderModel& model, Matrix K, const std::string& source);
/// Adds dampers to the body's terms: D; its skew part, if it is more than rounding, to G.
/// @throws Error if one triangle is missing. Collective.
void add_damping(SecondOrderModel& model, Matrix D, const std::string& source);
/// Adds gyroscopic forces: to the body's term G, or a term of another law. @throws Error if the
/// matrix is not skew. Collective.
void add_skew(SecondOrderModel& model, const Law& law, Matrix G,
              const std::string& source);

/// Damping attributes (or scalar datasets) alpha, beta, eta of the file, 0 where absent.
Damping read_damping(const Hdf5File& file);

/// Takes α and β out of a D that is proportional; leaves a general D alone.
void classify_damping(SecondOrderModel& model);

/// Writes /dofs and /nodes of a body that has coordinates: nodes are numbered in the
/// order of the rows (a node whose rows do not follow each other appears once for each
/// run of them); /nodes/id keeps their labels. Collective.
void write_dof_map(Hdf5File& file, const SecondOrderModel& model);

/// Reads them into a model whose rows are known. @throws Error for wrong lengths or
/// numbers. Collective.
void read_dof_map(const Hdf5File& file, SecondOrderModel& model);

/// Writes a body of matrices that read_body reads back and MATLAB and h5py open.
/// Collective.
void write_body(const SecondOrderModel& model, const std::string& path);

} // namespace flexgram
