//! The rigid motion of the lower teeth in every unit, and the file that says so to a scene.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};
use polar_grad::polar_rotation;
use serde_json::{Map, Value, json};

use crate::error::{ImportError, Result};

/// A rigid motion `x -> R x + t`, and how far points are from following it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidFit {
    /// The rotation R.
    pub rotation: Matrix3<f64>,
    /// The translation t, in the unit of the points.
    pub translation: Vector3<f64>,
    /// Root mean square over the points of the remaining distance, in their unit.
    pub residual_rms: f64,
    /// Largest remaining distance, in the unit of the points.
    pub residual_max: f64,
}

/// The rigid motion with the least squared distance between `R from_i + t` and `to_i` (orthogonal Procrustes; Kabsch 1976).
///
/// R is the rotation nearest to the correlation `sum (to_i - mean) (from_i - mean)^T`; a mirror image is never taken.
///
/// # Errors
/// [`ImportError::PointCount`] when the sets differ in length or are empty.
pub fn fit_rigid(from: &[Vector3<f64>], to: &[Vector3<f64>]) -> Result<RigidFit> {
    if from.len() != to.len() || from.is_empty() {
        return Err(ImportError::PointCount {
            from: from.len(),
            to: to.len(),
        });
    }
    let mean = |points: &[Vector3<f64>]| points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let (from_mean, to_mean) = (mean(from), mean(to));
    let pairs = || from.iter().zip(to);
    let correlation = pairs()
        .map(|(before, after)| (after - to_mean) * (before - from_mean).transpose())
        .sum::<Matrix3<f64>>();
    let rotation = polar_rotation(&correlation);
    let translation = to_mean - rotation * from_mean;
    let squares =
        pairs().map(|(before, after)| (rotation * before + translation - after).norm_squared());
    let (sum, max) = squares.fold((0.0, 0.0_f64), |(sum, max), s| (sum + s, max.max(s)));
    Ok(RigidFit {
        rotation,
        translation,
        residual_rms: (sum / from.len() as f64).sqrt(),
        residual_max: max.sqrt(),
    })
}

/// Rigid motions of the lower teeth by unit.
pub type JawMotions = BTreeMap<String, RigidFit>;

/// The motion of the lower teeth when they move: by more than `threshold` in the root mean square. Less is noise of the source, and
/// `None`.
///
/// # Errors
/// As [`fit_rigid`].
pub fn jaw_motion(
    rest: &[Vector3<f64>],
    moved: &[Vector3<f64>],
    threshold: f64,
) -> Result<Option<RigidFit>> {
    let fit = fit_rigid(rest, moved)?;
    let sum: f64 = rest
        .iter()
        .zip(moved)
        .map(|(a, b)| (b - a).norm_squared())
        .sum();
    let moves = (sum / rest.len() as f64).sqrt() > threshold;
    Ok(moves.then_some(fit))
}

/// The content of `jaw_train.json`, as a scene's `jaw.motions` takes it: per unit the rotation row by row, the translation and the root mean
/// square of the residual, with the length unit in their keys.
pub fn jaw_json(motions: &JawMotions, unit: &str) -> Value {
    let entries = motions.iter().map(|(name, fit)| {
        let mut entry = Map::new();
        let rows = fit.rotation.transpose();
        let rotation: Vec<f64> = rows.iter().map(|&x| rounded(x)).collect();
        let translation: Vec<f64> = fit.translation.iter().map(|&x| rounded(x)).collect();
        entry.insert("rotation_rowmajor".into(), rotation.into());
        entry.insert(format!("translation_{unit}"), translation.into());
        entry.insert(format!("rms_{unit}"), rounded(fit.residual_rms).into());
        (name.clone(), Value::Object(entry))
    });
    json!({
        "units": unit,
        "convention": "x' = R x + t of the lower teeth; the upper teeth stay",
        "unit_jaw": entries.collect::<Map<_, _>>(),
    })
}

/// Nine decimals: far below what the sources hold, and without the last bits that differ between machines.
pub(crate) fn rounded(x: f64) -> f64 {
    // Adding zero turns -0 into 0.
    (x * 1e9).round() / 1e9 + 0.0
}
