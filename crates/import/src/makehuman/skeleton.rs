//! The default rig: joints in the neutral, and linear blend skinning.

use std::collections::{BTreeMap, HashMap};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;

use super::assets::{Assets, RIG, WEIGHTS};
use super::poses::{Pose, PoseSet};
use crate::error::{ImportError, Result};

/// A bone that takes part in the poses.
pub struct Bone {
    /// Its name in the rig.
    pub name: String,
    /// The nearest bone of the skeleton among its ancestors; none for the root.
    pub parent: Option<usize>,
    /// Where it begins and turns, in metres.
    pub head: Vector3<f64>,
    /// Where it ends, in metres.
    pub tail: Vector3<f64>,
}

/// The bones of a set of poses, each behind its parent, and what they move.
pub struct Skeleton {
    /// The bones.
    pub bones: Vec<Bone>,
    /// Per vertex of the body: bones with their weights, which sum to 1.
    weights: Vec<Vec<(usize, f64)>>,
}

#[derive(Deserialize)]
struct RigBone {
    head: Place,
    tail: Place,
    parent: String,
}

/// How the rig finds a point on a mesh of any shape.
#[derive(Deserialize)]
#[serde(tag = "strategy", rename_all = "UPPERCASE")]
enum Place {
    /// The mean of a joint's helper cube.
    Cube {
        cube_name: String,
    },
    Vertex {
        vertex_index: usize,
    },
    Mean {
        vertex_indices: Vec<usize>,
    },
}

#[derive(Deserialize)]
struct Weights {
    weights: BTreeMap<String, Vec<(usize, f64)>>,
}

type Rig = BTreeMap<String, RigBone>;

impl Skeleton {
    /// Reads the rig and its weights for the bones of a set of poses.
    ///
    /// # Errors
    /// When a bone is unknown, the rig has a circle, a place or a weight names a vertex that does not exist, or a vertex of the body has
    /// no weight.
    pub fn read(assets: &mut Assets, poses: &PoseSet) -> Result<Self> {
        let rig: Rig = assets.json(RIG)?;
        let Weights { weights } = assets.json(WEIGHTS)?;
        let names = in_order(&rig, poses, assets)?;
        let index: HashMap<&str, usize> = names.iter().map(String::as_str).zip(0..).collect();
        let bones = names.iter().map(|name| {
            let bone = &rig[name];
            Ok(Bone {
                name: name.clone(),
                parent: nearest(&rig, &bone.parent, &index, assets)?,
                head: bone.head.find(assets)?,
                tail: bone.tail.find(assets)?,
            })
        });
        let bones = bones.collect::<Result<Vec<Bone>>>()?;
        let body = assets.group("body")?;
        let mut own = vec![BTreeMap::new(); body.len()];
        for (name, entries) in &weights {
            if !rig.contains_key(name) {
                return Err(unknown_bone(assets, WEIGHTS, name));
            }
            let Some(bone) = nearest(&rig, name, &index, assets)? else {
                continue;
            };
            for &(vertex, weight) in entries.iter().filter(|(vertex, _)| body.contains(vertex)) {
                *own[vertex - body.start].entry(bone).or_insert(0.0) += weight;
            }
        }
        let weights = own.into_iter().enumerate().map(|(vertex, own)| {
            let sum: f64 = own.values().sum();
            if !(sum > 0.0 && sum.is_finite()) {
                return Err(ImportError::NoWeight {
                    path: assets.path(WEIGHTS),
                    vertex,
                });
            }
            Ok(own.into_iter().map(|(bone, w)| (bone, w / sum)).collect())
        });
        Ok(Self {
            bones,
            weights: weights.collect::<Result<_>>()?,
        })
    }

    /// The rigid motion of every bone in a pose: it turns about its head, on top of its parent's motion.
    pub fn motions(&self, pose: &Pose) -> Vec<Isometry3<f64>> {
        let mut motions: Vec<Isometry3<f64>> = Vec::with_capacity(self.bones.len());
        for bone in &self.bones {
            let turn = UnitQuaternion::from_rotation_matrix(&pose.rotation(&bone.name));
            let about_head =
                Isometry3::from_parts(Translation3::from(bone.head - turn * bone.head), turn);
            let parent = bone.parent.map_or_else(Isometry3::identity, |p| motions[p]);
            motions.push(parent * about_head);
        }
        motions
    }

    /// Where linear blend skinning takes the vertices of the body.
    ///
    /// # Panics
    /// When there is not one motion for each bone, or `rest` is not the body.
    pub fn skin(&self, motions: &[Isometry3<f64>], rest: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        assert_eq!(rest.len(), self.weights.len(), "one weight list per vertex");
        let moved = rest.iter().zip(&self.weights).map(|(rest, weights)| {
            let places = weights.iter().map(|&(bone, weight)| {
                let motion = &motions[bone];
                weight * (motion.rotation * rest + motion.translation.vector)
            });
            places.sum()
        });
        moved.collect()
    }
}

impl Place {
    fn find(&self, assets: &Assets) -> Result<Vector3<f64>> {
        let all = assets.mesh.vertices();
        let vertices: Vec<usize> = match self {
            Self::Cube { cube_name } => assets.group(cube_name)?.collect(),
            Self::Vertex { vertex_index } => vec![*vertex_index],
            Self::Mean { vertex_indices } => vertex_indices.clone(),
        };
        let mut sum = Vector3::zeros();
        for &vertex in &vertices {
            sum += all.get(vertex).ok_or_else(|| ImportError::VertexBeyond {
                path: assets.path(RIG),
                vertex,
                vertices: all.len(),
            })?;
        }
        Ok(sum / vertices.len().max(1) as f64)
    }
}

fn unknown_bone(assets: &Assets, file: &str, name: &str) -> ImportError {
    ImportError::UnknownName {
        path: assets.path(file),
        kind: "bone",
        name: name.into(),
    }
}

/// The bones of the poses, each behind its ancestors.
fn in_order(rig: &Rig, poses: &PoseSet, assets: &Assets) -> Result<Vec<String>> {
    let turned = poses.poses.iter().flat_map(|pose| pose.turns.keys());
    for name in poses.bones.iter().chain(turned) {
        if !(rig.contains_key(name) && poses.bones.contains(name)) {
            return Err(unknown_bone(assets, RIG, name));
        }
    }
    let depths = poses.bones.iter().map(|name| {
        let depth = ancestors(rig, name, assets)?.len();
        Ok((depth, name.clone()))
    });
    let mut depths = depths.collect::<Result<Vec<_>>>()?;
    // Stable: bones of the same depth keep the order of the file.
    depths.sort_by_key(|&(depth, _)| depth);
    Ok(depths.into_iter().map(|(_, name)| name).collect())
}

/// A bone and its ancestors up to the root; nothing for no bone.
fn ancestors<'a>(rig: &'a Rig, name: &'a str, assets: &Assets) -> Result<Vec<&'a str>> {
    let mut chain = Vec::new();
    let mut next = name;
    while !next.is_empty() {
        if chain.len() == rig.len() {
            return Err(ImportError::NoRoot {
                path: assets.path(RIG),
                name: name.into(),
            });
        }
        chain.push(next);
        let bone = rig.get(next);
        next = &bone.ok_or_else(|| unknown_bone(assets, RIG, next))?.parent;
    }
    Ok(chain)
}

/// The first of a bone and its ancestors that is in the skeleton.
fn nearest(
    rig: &Rig,
    name: &str,
    index: &HashMap<&str, usize>,
    assets: &Assets,
) -> Result<Option<usize>> {
    let chain = ancestors(rig, name, assets)?;
    Ok(chain.iter().find_map(|name| index.get(name).copied()))
}
