//! Triangles to pixels: a z-buffer over bands of the picture, several samples a pixel, shading once for each triangle in it.

use crate::camera::Camera;
use crate::error::ReportError;
use crate::image::{Image, Rgb, check_size};
use crate::normals::{hollowness, vertex_normals};
use crate::shade::{Finish, Linear, SrgbTable, shade, to_linear};
use nalgebra::Vector3;
use rayon::prelude::*;

/// The colour of the paper behind everything this crate draws.
pub const BACKGROUND: Rgb = [250, 250, 251];

/// The colour of plain surfaces.
pub const CLAY: Rgb = [222, 201, 184];

/// Samples along each side of a pixel.
const SAMPLES: usize = 3;
/// Pixel rows in one unit of parallel work: small enough for its buffers to stay in the cache.
const BAND: usize = 16;
/// Positions are rounded to this part of a sample; edges are then exact integers and leave no cracks.
const SUBSAMPLE: f64 = 256.0;
/// Vertices further out than this many subsamples are pulled in, which keeps the integer edges from overflowing.
const GUARD: f64 = (1_u64 << 29) as f64;
/// Part of the light that a narrow groove loses.
const HOLLOW_SHADOW: f32 = 0.65;
const NOTHING: u32 = u32::MAX;

/// The colour of a surface.
#[derive(Clone, Copy, Debug)]
pub enum Colours<'a> {
    /// One colour all over, shaded as matt clay.
    Uniform(Rgb),
    /// One colour for each vertex, shaded gently so that it can be read against a scale.
    PerVertex(&'a [Rgb]),
}

/// A triangle mesh to be drawn; both sides of it are visible.
#[derive(Clone, Copy, Debug)]
pub struct Mesh<'a> {
    /// Vertex positions in length units.
    pub vertices: &'a [Vector3<f64>],
    /// Three vertices each, counter-clockwise seen from outside.
    pub triangles: &'a [[u32; 3]],
    /// Its colour.
    pub colours: Colours<'a>,
}

/// Draws a mesh as `camera` sees it, lit from the viewer's upper left on a light background.
///
/// Edges are smoothed by 3 x 3 samples a pixel, normals are interpolated, and the result does not depend on the number of
/// threads. Triangles that reach behind the eye of a perspective view are left out.
///
/// # Errors
/// When a triangle names a missing vertex, a vertex is not finite, colours and vertices differ in number, or a side of the
/// picture is 0 or above [`crate::SIDE_LIMIT`].
pub fn render(
    mesh: &Mesh,
    camera: &Camera,
    width: usize,
    height: usize,
) -> Result<Image, ReportError> {
    check_size(width, height)?;
    check_mesh(mesh)?;
    let scene = Scene::new(mesh, camera, width, height);
    let bands = scene.triangles_by_band(height);
    let table = SrgbTable::new();
    let mut pixels = vec![BACKGROUND; width * height];
    pixels
        .par_chunks_mut(width * BAND)
        .zip(&bands)
        .enumerate()
        .filter(|(_, (_, triangles))| !triangles.is_empty())
        .for_each(|(band, (pixels, triangles))| {
            let samples = scene.cover(band, pixels.len() / width, triangles);
            scene.resolve(&samples, band, pixels, &table);
        });
    Ok(Image::from_pixels(width, height, pixels))
}

pub(crate) fn check_mesh(mesh: &Mesh) -> Result<(), ReportError> {
    let vertices = mesh.vertices.len();
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|&&vertex| vertex as usize >= vertices) {
            return Err(ReportError::VertexIndex {
                triangle,
                vertex,
                vertices,
            });
        }
    }
    for (vertex, position) in mesh.vertices.iter().enumerate() {
        if let Some(&value) = position.iter().find(|value| !value.is_finite()) {
            return Err(ReportError::NonFiniteVertex { vertex, value });
        }
    }
    match mesh.colours {
        Colours::PerVertex(colours) if colours.len() != vertices => Err(ReportError::ColourCount {
            colours: colours.len(),
            vertices,
        }),
        _ => Ok(()),
    }
}

/// A triangle in samples, ready to be scanned.
struct ScreenTriangle {
    /// Corners, counter-clockwise on the screen (y down: the signed area below is positive), in subsamples.
    corners: [[i64; 2]; 3],
    /// Nearness at the corners.
    nearness: [f32; 3],
    /// The mesh's vertices in the order of `corners`.
    vertices: [u32; 3],
    /// Twice the area in square subsamples.
    area: i64,
    /// True when the outside faces the viewer.
    front: bool,
}

struct Scene<'a> {
    mesh: &'a Mesh<'a>,
    width: usize,
    perspective: bool,
    triangles: Vec<ScreenTriangle>,
    /// Unit vertex normals in right, up, backwards.
    normals: Vec<[f32; 3]>,
    colours: Vec<Linear>,
    /// Part of the light that reaches each vertex; empty where colours must stay as they are.
    reached: Vec<f32>,
    finish: Finish,
}

/// Depth and owner of every sample of one band.
struct Samples {
    nearness: Vec<f32>,
    owner: Vec<u32>,
}

impl<'a> Scene<'a> {
    fn new(mesh: &'a Mesh<'a>, camera: &Camera, width: usize, height: usize) -> Self {
        let outwards = vertex_normals(mesh.vertices, mesh.triangles);
        let normals = outwards
            .iter()
            .map(|normal| camera.turn(normal).map(|value| value as f32).into())
            .collect();
        let reached = match mesh.colours {
            Colours::Uniform(_) => hollowness(mesh.vertices, mesh.triangles, &outwards)
                .iter()
                .map(|hollow| 1.0 - HOLLOW_SHADOW * hollow)
                .collect(),
            Colours::PerVertex(_) => Vec::new(),
        };
        let (colours, finish) = match mesh.colours {
            Colours::Uniform(colour) => (vec![to_linear(colour)], Finish::Clay),
            Colours::PerVertex(colours) => (
                colours.iter().copied().map(to_linear).collect(),
                Finish::Data,
            ),
        };
        Self {
            mesh,
            width,
            perspective: camera.is_perspective(),
            triangles: project_triangles(mesh, camera, width, height),
            normals,
            colours,
            reached,
            finish,
        }
    }

    /// For each band the triangles that may touch it, in their order in the mesh.
    fn triangles_by_band(&self, height: usize) -> Vec<Vec<u32>> {
        let mut bands = vec![Vec::new(); height.div_ceil(BAND)];
        let band_height = (BAND * SAMPLES) as i64 * SUBSAMPLE as i64;
        let last = bands.len() as i64 - 1;
        for (index, triangle) in self.triangles.iter().enumerate() {
            let rows = triangle
                .corners
                .map(|corner| corner[1].div_euclid(band_height));
            let (low, high) = (
                rows[0].min(rows[1]).min(rows[2]),
                rows[0].max(rows[1]).max(rows[2]),
            );
            if high < 0 || low > last {
                continue;
            }
            for band in low.max(0)..=high.min(last) {
                bands[band as usize].push(index as u32);
            }
        }
        bands
    }

    /// Finds the nearest triangle at every sample of a band.
    fn cover(&self, band: usize, pixel_rows: usize, triangles: &[u32]) -> Samples {
        let columns = self.width * SAMPLES;
        let rows = pixel_rows * SAMPLES;
        let mut samples = Samples {
            nearness: vec![f32::NEG_INFINITY; columns * rows],
            owner: vec![NOTHING; columns * rows],
        };
        let top = band * BAND * SAMPLES;
        for &index in triangles {
            self.triangles[index as usize].scan(index, top, columns, rows, &mut samples);
        }
        samples
    }

    /// Shades the pixels of a band and averages their samples in linear light.
    fn resolve(&self, samples: &Samples, band: usize, pixels: &mut [Rgb], table: &SrgbTable) {
        let columns = self.width * SAMPLES;
        let background = to_linear(BACKGROUND);
        for (index, pixel) in pixels.iter_mut().enumerate() {
            let (x, y) = (index % self.width, index / self.width);
            let start = y * SAMPLES * columns + x * SAMPLES;
            let rows: [&[u32]; SAMPLES] =
                std::array::from_fn(|row| &samples.owner[start + row * columns..][..SAMPLES]);
            let first = rows[0][0];
            let colour_of = |owner| match owner {
                NOTHING => background,
                _ => self.shade_at(owner, x, band * BAND + y),
            };
            // Most pixels lie inside one triangle or beside the mesh.
            let one_owner = rows
                .iter()
                .all(|row| row.iter().all(|&owner| owner == first));
            let colour = match (one_owner, first) {
                (true, NOTHING) => continue,
                (true, _) => colour_of(first),
                (false, _) => mean_colour(rows, colour_of),
            };
            *pixel = table.encode(colour, dither(x, band * BAND + y));
        }
    }

    /// The colour of a triangle at the middle of a pixel, or at its point nearest to that.
    fn shade_at(&self, index: u32, x: usize, y: usize) -> Linear {
        let triangle = &self.triangles[index as usize];
        let weights = triangle.weights(x, y, self.perspective);
        let mix = |values: [[f32; 3]; 3]| -> [f32; 3] {
            std::array::from_fn(|axis| {
                (0..3)
                    .map(|corner| weights[corner] * values[corner][axis])
                    .sum()
            })
        };
        let colour = match self.mesh.colours {
            Colours::Uniform(_) => {
                let light = triangle
                    .vertices
                    .map(|vertex| self.reached[vertex as usize]);
                let light: f32 = (0..3).map(|corner| weights[corner] * light[corner]).sum();
                self.colours[0].map(|channel| channel * light)
            }
            Colours::PerVertex(_) => mix(triangle
                .vertices
                .map(|vertex| self.colours[vertex as usize])),
        };
        let mut normal = mix(triangle
            .vertices
            .map(|vertex| self.normals[vertex as usize]));
        if !triangle.front {
            normal = normal.map(|value| -value);
        }
        // Interpolated normals may lean away at the outline; a visible surface never faces more than sideways.
        normal[2] = normal[2].max(0.0);
        let length = normal.iter().map(|value| value * value).sum::<f32>().sqrt();
        let normal = if length > 1e-12 {
            normal.map(|value| value / length)
        } else {
            [0.0, 0.0, 1.0]
        };
        shade(normal, colour, self.finish)
    }
}

/// The mean over the samples of a pixel; neighbours with one owner share their colour.
fn mean_colour(rows: [&[u32]; SAMPLES], colour_of: impl Fn(u32) -> Linear) -> Linear {
    let mut known = None;
    let mut sum = [0.0; 3];
    for &owner in rows.into_iter().flatten() {
        let colour = match known {
            Some((last, colour)) if last == owner => colour,
            _ => colour_of(owner),
        };
        known = Some((owner, colour));
        sum = std::array::from_fn(|channel| sum[channel] + colour[channel]);
    }
    sum.map(|total| total / (SAMPLES * SAMPLES) as f32)
}

fn project_triangles(
    mesh: &Mesh,
    camera: &Camera,
    width: usize,
    height: usize,
) -> Vec<ScreenTriangle> {
    let (scale, offset) = camera.to_pixels(width, height);
    let unit = SAMPLES as f64 * SUBSAMPLE;
    let snap = |value: f64| (value * unit).round().clamp(-GUARD, GUARD) as i64;
    let corners: Vec<_> = mesh
        .vertices
        .iter()
        .map(|vertex| {
            camera.project(vertex).map(|seen| {
                let [x, y] = seen.plane;
                let position = [snap(offset[0] + scale * x), snap(offset[1] - scale * y)];
                (position, seen.nearness as f32)
            })
        })
        .collect();
    mesh.triangles
        .iter()
        .filter_map(|triangle| {
            let [Some(a), Some(b), Some(c)] = triangle.map(|vertex| corners[vertex as usize])
            else {
                return None;
            };
            ScreenTriangle::new([a, b, c], *triangle)
        })
        .collect()
}

impl ScreenTriangle {
    /// Nothing when the triangle is seen exactly edge on.
    fn new(corners: [([i64; 2], f32); 3], vertices: [u32; 3]) -> Option<Self> {
        let area = edge(corners[0].0, corners[1].0, corners[2].0);
        if area == 0 {
            return None;
        }
        // With y pointing down a front face runs clockwise in these coordinates: negative area.
        let front = area < 0;
        let order = if front { [0, 2, 1] } else { [0, 1, 2] };
        Some(Self {
            corners: order.map(|corner| corners[corner].0),
            nearness: order.map(|corner| corners[corner].1),
            vertices: order.map(|corner| vertices[corner]),
            area: area.abs(),
            front,
        })
    }

    /// Puts the triangle into the samples it covers and is nearest in; `top` is the first sample row of the band.
    fn scan(&self, index: u32, top: usize, columns: usize, rows: usize, samples: &mut Samples) {
        let unit = SUBSAMPLE as i64;
        let half = unit / 2;
        let range = |axis: usize, first: i64, count: usize| {
            let values = self.corners.map(|corner| corner[axis]);
            let low =
                (values.iter().min().expect("three corners") - half + unit - 1).div_euclid(unit);
            let high = (values.iter().max().expect("three corners") - half).div_euclid(unit);
            (low.max(first), high.min(first + count as i64 - 1))
        };
        let (left, right) = range(0, 0, columns);
        let (upper, lower) = range(1, top as i64, rows);
        if left > right || upper > lower {
            return;
        }
        let [a, b, c] = self.corners;
        let sides = [[b, c], [c, a], [a, b]];
        let start = [left * unit + half, upper * unit + half];
        let mut row_edges = sides.map(|[from, to]| edge(from, to, start));
        let step_right = sides.map(|[from, to]| (from[1] - to[1]) * unit);
        let step_down = sides.map(|[from, to]| (to[0] - from[0]) * unit);
        let per_area = self.nearness.map(|near| f64::from(near) / self.area as f64);
        let plane = |edges: [i64; 3]| -> f32 {
            (0..3)
                .map(|side| edges[side] as f64 * per_area[side])
                .sum::<f64>() as f32
        };
        let slope = plane(step_right);
        for row in upper..=lower {
            let (first, last) = span(row_edges, step_right, right - left);
            if first <= last {
                let begin = (row - top as i64) as usize * columns + (left + first) as usize;
                let line = begin..=begin + (last - first) as usize;
                let near_left = plane(std::array::from_fn(|side| {
                    row_edges[side] + first * step_right[side]
                }));
                let nearness = &mut samples.nearness[line.clone()];
                for (place, (nearest, owner)) in nearness
                    .iter_mut()
                    .zip(&mut samples.owner[line])
                    .enumerate()
                {
                    let near = near_left + place as i32 as f32 * slope;
                    let wins = near > *nearest;
                    *nearest = if wins { near } else { *nearest };
                    *owner = if wins { index } else { *owner };
                }
            }
            for side in 0..3 {
                row_edges[side] += step_down[side];
            }
        }
    }

    /// Weights of the corners at the middle of a pixel, pulled to the triangle where that lies outside.
    fn weights(&self, x: usize, y: usize, perspective: bool) -> [f32; 3] {
        let unit = SAMPLES as i64 * SUBSAMPLE as i64;
        let point = [x as i64 * unit + unit / 2, y as i64 * unit + unit / 2];
        let [a, b, c] = self.corners;
        let mut weights = [edge(b, c, point), edge(c, a, point), edge(a, b, point)]
            .map(|value| value.max(0) as f32);
        if perspective {
            for (weight, nearness) in weights.iter_mut().zip(self.nearness) {
                *weight *= nearness;
            }
        }
        let sum: f32 = weights.iter().sum();
        weights.map(|weight| weight / sum)
    }
}

/// First and last step (0 to `steps`) at which no edge is negative, exactly; empty when first > last.
fn span(edges: [i64; 3], step_right: [i64; 3], steps: i64) -> (i64, i64) {
    let (mut first, mut last) = (0, steps);
    for (edge, step) in edges.into_iter().zip(step_right) {
        match step.signum() {
            1 if edge < 0 => first = first.max((step - 1 - edge) / step),
            -1 if edge >= 0 => last = last.min(edge / -step),
            -1 => last = -1,
            0 if edge < 0 => last = -1,
            _ => {}
        }
    }
    (first, last)
}

/// Twice the signed area of the triangle (from, to, point).
fn edge(from: [i64; 2], to: [i64; 2], point: [i64; 2]) -> i64 {
    (to[0] - from[0]) * (point[1] - from[1]) - (to[1] - from[1]) * (point[0] - from[0])
}

/// A fixed pattern between -0.5 and 0.5 without visible structure (interleaved gradient noise, Jimenez 2014).
fn dither(x: usize, y: usize) -> f32 {
    let (x, y) = (x as i32, y as i32);
    let phase = 52.982_918 * (0.067_110_56 * x as f32 + 0.005_837_15 * y as f32).fract();
    phase.fract() - 0.5
}
