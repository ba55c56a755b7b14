//! What the effects of a scene know by name: bodies that the flesh may touch, and paint on the skin.

use crate::error::{Result, TrainerError, file_error};
use crate::files::{read_json, write_json};
use crate::matching::check_unit;
use hex_mesh::{HexMesh, NodeRegion};
use nalgebra::Vector3;
use pd_solver::{EffectSpec, ElementSet, Obstacle};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::{Path, PathBuf};
use surface_mesh::{ClosestPoint, ClosestPoints, MorphedSurface, Surface, read_surface, write_glb};

/// A body that contact keeps off, as a scene lists it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObstacleSettings {
    /// Name, for the `obstacles` of an effect.
    pub name: String,
    /// Its surface, closed or not: OBJ, glTF or GLB, relative to the data folder.
    pub file: PathBuf,
    /// The part of it that is there, by vertices at rest: the crowns of teeth without the roots. All of it where not given.
    pub region: Option<NodeRegion>,
    /// Whether the jaw joint moves it.
    #[serde(default)]
    pub moves: bool,
}

/// Paint on the skin, as a scene lists it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaintSettings {
    /// Name, for the `elements` of an effect.
    pub name: String,
    /// A text file with a share from 0 to 1 on a line for each vertex of the surface, relative to the data folder.
    pub file: PathBuf,
}

/// A body that contact keeps off.
#[derive(Debug, Clone, PartialEq)]
pub struct Prop {
    /// Its name.
    pub name: String,
    /// Whether the jaw joint moves it.
    pub moves: bool,
    /// Its surface at rest.
    pub surface: Surface,
}

/// Paint on the skin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Paint {
    /// Its name.
    pub name: String,
    /// A share from 0 to 1 per vertex of the surface.
    pub shares: Vec<f64>,
}

/// All of them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Props {
    /// Bodies that contact keeps off.
    pub obstacles: Vec<Prop>,
    /// Paint on the skin.
    pub paints: Vec<Paint>,
}

/// What `props.json` holds.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    obstacles: Vec<KeptObstacle>,
    paints: Vec<Paint>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeptObstacle {
    name: String,
    moves: bool,
}

impl Props {
    /// Reads what a scene, or a file of effects, lists.
    ///
    /// # Errors
    /// When a file cannot be read, two have one name, a region holds no triangle, or paint is none.
    pub fn load(
        obstacles: &[ObstacleSettings],
        paints: &[PaintSettings],
        unit: &str,
        data: &Path,
    ) -> Result<Self> {
        let mut props = Self::default();
        for obstacle in obstacles {
            let path = data.join(&obstacle.file);
            let file = read_surface(&path)?;
            check_unit(&path, &file, unit);
            let surface = match &obstacle.region {
                Some(region) => part(&obstacle.name, &file.surface, region)?,
                None => file.surface,
            };
            props.obstacles.push(Prop {
                name: obstacle.name.clone(),
                moves: obstacle.moves,
                surface,
            });
        }
        for paint in paints {
            props.paints.push(Paint {
                name: paint.name.clone(),
                shares: read_paint(&data.join(&paint.file))?,
            });
        }
        Self::default().with(props)
    }

    /// These and others.
    ///
    /// # Errors
    /// When two have one name.
    pub fn with(mut self, others: Self) -> Result<Self> {
        self.obstacles.extend(others.obstacles);
        self.paints.extend(others.paints);
        let obstacles = self.obstacles.iter().map(|o| ("obstacle", &o.name));
        let paints = self.paints.iter().map(|p| ("paint", &p.name));
        let mut seen = BTreeSet::new();
        for (what, name) in obstacles.chain(paints) {
            if !seen.insert((what, name)) {
                let name = name.clone();
                return Err(TrainerError::SameName { what, name });
            }
        }
        Ok(self)
    }

    fn obstacle(&self, name: &str) -> Option<&Prop> {
        self.obstacles.iter().find(|o| o.name == name)
    }

    /// What the joint moves.
    pub(crate) fn moving(&self) -> impl Iterator<Item = &Prop> {
        self.obstacles.iter().filter(|o| o.moves)
    }

    /// Writes everything into a folder that exists, `props.json` last; nothing where there is nothing.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub(crate) fn write(&self, folder: &Path) -> Result<()> {
        if *self == Self::default() {
            return Ok(());
        }
        let mut obstacles = Vec::new();
        for (i, obstacle) in self.obstacles.iter().enumerate() {
            let surface = MorphedSurface::new(obstacle.surface.clone(), Vec::new())?;
            write_glb(obstacle_path(folder, i), &surface)?;
            obstacles.push(KeptObstacle {
                name: obstacle.name.clone(),
                moves: obstacle.moves,
            });
        }
        let paints = self.paints.clone();
        write_json(&folder.join("props.json"), &Kept { obstacles, paints })
    }

    /// Reads what [`Props::write`] wrote.
    ///
    /// # Errors
    /// When a file cannot be read or is damaged.
    pub(crate) fn read(folder: &Path) -> Result<Self> {
        let path = folder.join("props.json");
        if !path.exists() {
            return Ok(Self::default());
        }
        let kept: Kept = read_json(&path)?;
        let obstacles = kept.obstacles.into_iter().enumerate().map(|(i, kept)| {
            Ok(Prop {
                name: kept.name,
                moves: kept.moves,
                surface: read_surface(obstacle_path(folder, i))?.surface,
            })
        });
        Ok(Self {
            obstacles: obstacles.collect::<Result<_>>()?,
            paints: kept.paints,
        })
    }

    /// Puts what is named in place of its names.
    ///
    /// # Errors
    /// When a name is not known; `place` says where an effect stands.
    pub(crate) fn put_into(
        &self,
        effects: &mut [EffectSpec],
        shares: &BTreeMap<String, Vec<f64>>,
        place: impl Fn(usize) -> String,
    ) -> Result<()> {
        for (i, effect) in effects.iter_mut().enumerate() {
            match effect {
                EffectSpec::Contact { obstacles, .. } => {
                    for obstacle in obstacles {
                        let Obstacle::Named { name } = obstacle else {
                            continue;
                        };
                        let Some(prop) = self.obstacle(name) else {
                            let known = self.obstacles.iter().map(|o| &o.name);
                            return Err(unknown(place(i), "obstacle", name, known));
                        };
                        *obstacle = Obstacle::Surface {
                            vertices: prop.surface.vertices().iter().map(|&x| x.into()).collect(),
                            triangles: prop.surface.triangles().to_vec(),
                        };
                    }
                }
                EffectSpec::Stiffness { elements, .. }
                | EffectSpec::Activation { elements, .. } => {
                    if let ElementSet::Named(name) = elements {
                        let Some(shares) = shares.get(name) else {
                            return Err(unknown(place(i), "paint", name, shares.keys()));
                        };
                        *elements = ElementSet::Painted(shares.clone());
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Where the vertices of what the joint moves are in [`Parameters::obstacles`](pd_solver::Parameters::obstacles), for effects with
    /// their names.
    pub(crate) fn moved_places(&self, effects: &[EffectSpec]) -> Vec<Range<usize>> {
        let mut places = Vec::new();
        let mut first = 0;
        for effect in effects {
            let EffectSpec::Contact { obstacles, .. } = effect else {
                continue;
            };
            for obstacle in obstacles {
                let (count, moves) = match obstacle {
                    Obstacle::Plane { .. } => (0, false),
                    Obstacle::Surface { vertices, .. } => (vertices.len(), false),
                    Obstacle::Named { name } => self
                        .obstacle(name)
                        .map_or((0, false), |o| (o.surface.vertex_count(), o.moves)),
                };
                if moves {
                    places.push(first..first + count);
                }
                first += count;
            }
        }
        places
    }

    /// The share of every element under each paint: that of the skin nearest to its centre.
    ///
    /// # Errors
    /// When paint has another number of shares than the surface vertices.
    pub(crate) fn element_shares(
        &self,
        surface: &Surface,
        mesh: &HexMesh,
    ) -> Result<BTreeMap<String, Vec<f64>>> {
        let mut all = BTreeMap::new();
        if self.paints.is_empty() {
            return Ok(all);
        }
        let skin = ClosestPoints::new(surface);
        let half = Vector3::repeat(mesh.element_size() / 2.0);
        let centres = (0..mesh.elements().len()).map(|e| mesh.element_corner(e) + half);
        let nearest: Vec<_> = centres.map(|x| skin.to(&x)).collect();
        for paint in &self.paints {
            let (found, expected) = (paint.shares.len(), surface.vertex_count());
            if found != expected {
                return Err(TrainerError::PaintCount {
                    name: paint.name.clone(),
                    found,
                    expected,
                });
            }
            let share = |at: &ClosestPoint| {
                let corners = surface.triangles()[at.triangle];
                let parts = corners.iter().zip(at.weights);
                let sum: f64 = parts.map(|(&v, w)| w * paint.shares[v as usize]).sum();
                // Weights sum to 1 but for roundoff.
                sum.clamp(0.0, 1.0)
            };
            all.insert(paint.name.clone(), nearest.iter().map(share).collect());
        }
        Ok(all)
    }
}

fn obstacle_path(folder: &Path, index: usize) -> PathBuf {
    folder.join(format!("obstacle-{}.glb", index + 1))
}

fn unknown<'a>(
    place: String,
    what: &'static str,
    name: &str,
    known: impl Iterator<Item = &'a String>,
) -> TrainerError {
    TrainerError::UnknownProp {
        place,
        what,
        name: name.to_string(),
        known: known.map(String::as_str).collect::<Vec<_>>().join(", "),
    }
}

/// The triangles all of whose vertices a region holds.
fn part(name: &str, surface: &Surface, region: &NodeRegion) -> Result<Surface> {
    let mesh_error = |source| TrainerError::Mesh {
        name: format!("the obstacle `{name}`"),
        source,
    };
    let inside = region
        .contains(surface.vertices(), 0.0)
        .map_err(mesh_error)?;
    let mut number = vec![None; inside.len()];
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for t in surface.triangles() {
        if t.iter().all(|&v| inside[v as usize]) {
            triangles.push(t.map(|v| {
                *number[v as usize].get_or_insert_with(|| {
                    vertices.push(surface.vertices()[v as usize]);
                    vertices.len() as u32 - 1
                })
            }));
        }
    }
    if triangles.is_empty() {
        return Err(TrainerError::EmptyPart {
            name: name.to_string(),
        });
    }
    Ok(Surface::from_triangles(vertices, triangles)?)
}

/// A number from 0 to 1 on every line; empty lines and what follows a `#` do not count.
fn read_paint(path: &Path) -> Result<Vec<f64>> {
    let text = std::fs::read_to_string(path).map_err(file_error("read the paint", path))?;
    parse_paint(&text, path)
}

/// As a file of paint is read, from its text; `path` is named in errors.
///
/// # Errors
/// When a line is no number from 0 to 1.
pub fn parse_paint(text: &str, path: &Path) -> Result<Vec<f64>> {
    let lines = text.lines().zip(1..);
    let numbers = lines.filter_map(|(line, at)| {
        let number = line.split('#').next().unwrap_or_default().trim();
        (!number.is_empty()).then_some((number, at))
    });
    let share = |(number, line): (&str, usize)| match number.parse::<f64>() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err(TrainerError::PaintLine {
            path: path.to_path_buf(),
            line,
            found: number.chars().take(40).collect(),
        }),
    };
    numbers.map(share).collect()
}

#[cfg(test)]
mod tests;
