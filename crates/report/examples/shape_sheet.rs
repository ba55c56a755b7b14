//! Writes a comparison sheet of a wobbling ball, one large picture and a plot into a folder.
//!
//! ```text
//! cargo run --release -p report --example shape_sheet -- FOLDER
//! ```

use nalgebra::Vector3;
use report::{CLAY, Camera, Colours, ComparisonSheet, LinePlot, Mesh, Row, Series, render};
use std::error::Error;
use std::path::PathBuf;
use surface_mesh::primitives::icosphere;

/// The ball with `lobes` waves of the given height around it.
fn wobble(ball: &[Vector3<f64>], lobes: f64, height: f64) -> Vec<Vector3<f64>> {
    ball.iter()
        .map(|p| {
            let around = p.z.atan2(p.x);
            p * (1.0
                + height * (lobes * around).cos() * (1.0 - p.y * p.y)
                + 0.1 * (3.0 * p.y).sin())
        })
        .collect()
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("usage: shape_sheet FOLDER")?);
    std::fs::create_dir_all(&folder)?;
    let ball = icosphere(5, 1.0);

    let names = ["two lobes", "three lobes", "four lobes"];
    let targets: Vec<_> = (2..5)
        .map(|lobes| wobble(ball.vertices(), f64::from(lobes), 0.25))
        .collect();
    let reached: Vec<_> = (2..5)
        .map(|lobes| wobble(ball.vertices(), f64::from(lobes), 0.245))
        .collect();
    let errors: Vec<Vec<f64>> = targets
        .iter()
        .zip(&reached)
        .map(|(target, reached)| {
            target
                .iter()
                .zip(reached)
                .map(|(a, b)| 10.0 * (a - b).norm())
                .collect()
        })
        .collect();
    let mut sheet = ComparisonSheet::new("Wobbling ball, 20 mm across", "mm")
        .view(Vector3::new(-0.3, -0.4, -1.0), Vector3::y());
    for (index, name) in names.into_iter().enumerate() {
        sheet = sheet.row(Row {
            name,
            triangles: ball.triangles(),
            target_triangles: None,
            target: &targets[index],
            simulated: &reached[index],
            errors: &errors[index],
            note: "waves 2 % too low",
        });
    }
    for (page, image) in sheet.render()?.iter().enumerate() {
        image.write_png(folder.join(format!("sheet-{}.png", page + 1)))?;
    }

    let camera = Camera::framing_perspective(
        &targets[1],
        Vector3::new(-0.3, -0.4, -1.0),
        Vector3::y(),
        0.35,
    )?;
    let mesh = Mesh {
        vertices: &targets[1],
        triangles: ball.triangles(),
        colours: Colours::Uniform(CLAY),
    };
    render(&mesh, &camera, 800, 800)?.write_png(folder.join("ball.png"))?;

    let curve = |rate: f64| {
        (1..=200)
            .map(|epoch| (f64::from(epoch), (-rate * f64::from(epoch)).exp() + 1e-4))
            .collect()
    };
    let plot = LinePlot {
        title: "Loss".into(),
        x_label: "epoch".into(),
        y_label: "mean squared error (mm^2)".into(),
        series: vec![
            Series::new("slow", curve(0.02)),
            Series::new("fast", curve(0.05)),
        ],
        log_x: false,
        log_y: true,
        markers: false,
        labels: Vec::new(),
    };
    plot.write_svg(folder.join("loss.svg"))?;
    plot.write_png(folder.join("loss.png"))?;

    let front = |power: i32| {
        (0..6)
            .map(|step| (0.03 * 4_f64.powi(step), 2_f64.powi(-power * step)))
            .collect()
    };
    let accuracy = LinePlot {
        title: "Accuracy against time".into(),
        x_label: "time (s)".into(),
        y_label: "largest error (mm)".into(),
        series: vec![
            Series::new("local/global", front(1)),
            Series::new("L-BFGS", front(2)),
            Series::new("Newton", front(4)),
        ],
        log_x: true,
        log_y: true,
        markers: true,
        labels: Vec::new(),
    };
    accuracy.write_png(folder.join("accuracy.png"))?;
    println!("pictures are in {}", folder.display());
    Ok(())
}
