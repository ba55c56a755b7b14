//! Where the scene's nodes put a mesh.

use gltf::json::{Index, Mesh, Node, Root};
use nalgebra::{Matrix3, Matrix4, Quaternion, UnitQuaternion, Vector3};

use crate::GltfProblem;

/// The map `x -> linear x + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placement {
    pub linear: Matrix3<f64>,
    pub translation: Vector3<f64>,
}

impl Placement {
    const IDENTITY: Self = Self {
        linear: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        translation: Vector3::new(0.0, 0.0, 0.0),
    };

    fn after(&self, inner: &Self) -> Self {
        Self {
            linear: self.linear * inner.linear,
            translation: self.linear * inner.translation + self.translation,
        }
    }

    /// Whether the map mirrors, which turns triangles inside out.
    pub fn mirrors(&self) -> bool {
        self.linear.determinant() < 0.0
    }
}

/// The world transform of the node that uses `mesh`; `None` when there is nothing to apply.
///
/// A node with a skin does not move its mesh (glTF 2.0, section 3.7.3.3). Several nodes must agree.
pub(super) fn placement(root: &Root, mesh: Index<Mesh>) -> Result<Option<Placement>, GltfProblem> {
    let parents = parents(root)?;
    let mut placed: Option<(usize, Placement)> = None;
    for (node, data) in root.nodes.iter().enumerate() {
        if data.mesh.map(|index| index.value()) != Some(mesh.value()) {
            continue;
        }
        let here = if data.skin.is_some() {
            Placement::IDENTITY
        } else {
            world(root, &parents, node)?
        };
        match placed {
            Some((first, there)) if there != here => {
                return Err(GltfProblem::SeveralPlacements {
                    first,
                    second: node,
                });
            }
            _ => placed = Some((node, here)),
        }
    }
    Ok(placed
        .map(|(_, placement)| placement)
        .filter(|placement| *placement != Placement::IDENTITY))
}

fn parents(root: &Root) -> Result<Vec<Option<usize>>, GltfProblem> {
    let mut parents = vec![None; root.nodes.len()];
    for (node, data) in root.nodes.iter().enumerate() {
        for child in data.children.iter().flatten() {
            let index = child.value();
            *parents.get_mut(index).ok_or(GltfProblem::Missing {
                kind: "node",
                index,
                count: root.nodes.len(),
            })? = Some(node);
        }
    }
    Ok(parents)
}

fn world(root: &Root, parents: &[Option<usize>], node: usize) -> Result<Placement, GltfProblem> {
    let mut placement = local(node, &root.nodes[node])?;
    let mut ancestor = parents[node];
    for _ in 0..parents.len() {
        let Some(parent) = ancestor else {
            return Ok(placement);
        };
        placement = local(parent, &root.nodes[parent])?.after(&placement);
        ancestor = parents[parent];
    }
    Err(GltfProblem::NodeCycle { node })
}

fn local(index: usize, node: &Node) -> Result<Placement, GltfProblem> {
    let bad = GltfProblem::BadTransform { node: index };
    let placement = match &node.matrix {
        Some(matrix) => {
            let matrix = Matrix4::from_column_slice(matrix).cast::<f64>();
            if matrix.row(3) != Matrix4::identity().row(3) {
                return Err(bad);
            }
            Placement {
                linear: matrix.fixed_view::<3, 3>(0, 0).into(),
                translation: matrix.fixed_view::<3, 1>(0, 3).into(),
            }
        }
        None => {
            let vector = |entries: Option<[f32; 3]>, default: f32| {
                Vector3::from(entries.unwrap_or([default; 3])).cast::<f64>()
            };
            let [x, y, z, w] = node.rotation.unwrap_or_default().0.map(f64::from);
            let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.5).ok_or(bad)?;
            let scale = Matrix3::from_diagonal(&vector(node.scale, 1.0));
            Placement {
                linear: rotation.to_rotation_matrix().matrix() * scale,
                translation: vector(node.translation, 0.0),
            }
        }
    };
    let finite = placement
        .linear
        .iter()
        .chain(&placement.translation)
        .all(|x| x.is_finite());
    if finite {
        Ok(placement)
    } else {
        Err(GltfProblem::BadTransform { node: index })
    }
}
