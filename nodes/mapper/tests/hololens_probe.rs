//! probe
mod scene;
use scene::loomo;
use sidestep_mapper::{Config, Mapper};
use sidestep_msgs::*;
use std::collections::HashMap;

fn load(path: &str) -> (u32, u32, Vec<u16>) {
    let d = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap()));
    let mut r = d.read_info().unwrap();
    let mut buf = vec![0; r.output_buffer_size().unwrap()];
    let i = r.next_frame(&mut buf).unwrap();
    (i.width, i.height, buf.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect())
}

#[test]
fn probe() {
    let dir = "/work/shared/data/depth_hololens";
    let mut files: Vec<_> =
        std::fs::read_dir(format!("{dir}/depth")).unwrap().map(|f| f.unwrap().path()).collect();
    files.sort();
    let poses: Vec<Vec<f64>> = std::fs::read_to_string(format!("{dir}/poses.txt"))
        .unwrap()
        .lines()
        .map(|l| l.split_whitespace().map(|v| v.parse().unwrap()).collect())
        .collect();
    let k: Vec<f32> = std::fs::read_to_string(format!("{dir}/K.txt"))
        .unwrap()
        .split_whitespace()
        .map(|v| v.parse().unwrap())
        .collect();
    let far: f32 = std::env::var("FAR").ok().and_then(|v| v.parse().ok()).unwrap_or(3.5);
    let config = Config { far_m: far, grant_start_disc: false, ..Config::shipped() };
    let mut mapper = Mapper::new(&config, &loomo()).unwrap();
    let mut frame: Box<DepthFrame> = Box::new(DepthFrame::default());
    // batch: cell -> (obstacle points, frames with obstacle, floor points)
    let mut batch: HashMap<(i32, i32), (u32, u32, u32)> = HashMap::new();
    let (mut rec_n, mut rec_d, mut ff_n, mut ff_d) = (0u64, 0u64, 0u64, 0u64);
    let mut worst = std::time::Duration::ZERO;
    let mut total = std::time::Duration::ZERO;
    let mut rows = Vec::new();
    for (n, (file, m)) in files.iter().zip(&poses).enumerate() {
        let (w, h, px) = load(file.to_str().unwrap());
        // world (X,Y,Z) -> odom (X, -Z, Y + 1.53)
        let conv = |v: [f64; 3]| [v[0], -v[2], v[1]];
        let col = |c: usize| conv([m[c], m[4 + c], m[8 + c]]);
        let (rx, ry, rz) = (col(0), col(1), col(2));
        let t = conv([m[3], m[7], m[11]]);
        let t = [t[0], t[1], t[2] + 1.53];
        let yaw = rz[1].atan2(rz[0]);
        let (s, c) = yaw.sin_cos();
        let unyaw = |v: [f64; 3]| [c * v[0] + s * v[1], -s * v[0] + c * v[1], v[2]];
        let (bx, by, bz) = (unyaw(rx), unyaw(ry), unyaw(rz));
        // rotation matrix columns bx,by,bz -> quaternion
        let r = nalgebra::Matrix3::new(bx[0], by[0], bz[0], bx[1], by[1], bz[1], bx[2], by[2], bz[2]);
        let q =
            nalgebra::UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(r));
        let q = q.coords;
        let stamp = (n as u64 + 1) * 100_000_000;
        frame.capture_ns = stamp;
        (frame.width, frame.height, frame.metres_per_unit) = (w, h, 0.001);
        (frame.fx_px, frame.cx_px, frame.fy_px, frame.cy_px) = (k[0], k[2], k[4], k[5]);
        frame.camera = Isometry {
            translation_m: [0.0, 0.0, t[2] as f32],
            rotation_xyzw: [q[0] as f32, q[1] as f32, q[2] as f32, q[3] as f32],
            _pad: 0,
        };
        frame.pixels[..px.len()].copy_from_slice(&px);
        let pose = Pose2::new(t[0], t[1], yaw);
        mapper.odometry(&Odometry { stamp_ns: stamp, pose, ..Odometry::default() });
        let t0 = std::time::Instant::now();
        assert_eq!(mapper.depth(&frame), Status::Ok);
        let dt = t0.elapsed();
        worst = worst.max(dt);
        total += dt;
        let mut seen: HashMap<(i32, i32), (u32, u32)> = HashMap::new();
        for v in 0..h as usize {
            for u in 0..w as usize {
                let z = px[v * w as usize + u] as f64 * 0.001;
                if z < 0.35 || z > far as f64 {
                    continue;
                }
                let (a, b) =
                    ((u as f64 - k[2] as f64) / k[0] as f64 * z, (v as f64 - k[5] as f64) / k[4] as f64 * z);
                let p: Vec<f64> = (0..3).map(|i| t[i] + rx[i] * a + ry[i] * b + rz[i] * z).collect();
                let e = seen.entry(((p[0] / 0.05).floor() as i32, (p[1] / 0.05).floor() as i32)).or_default();
                let range = libm::hypot(p[0] - t[0], p[1] - t[1]);
                let _ = range;
                if p[2] > 0.12 && p[2] < 0.88 {
                    e.0 += 1;
                } else if p[2].abs() < 0.06 {
                    e.1 += 1;
                }
            }
        }
        for (cell, (o, f)) in &seen {
            let e = batch.entry(*cell).or_default();
            e.0 += o;
            e.1 += u32::from(*o >= 5);
            e.2 += f;
        }
        if n % 10 == 9 || n + 1 == files.len() {
            let mut map = Box::new(SafetyMap::default());
            mapper.write_safety(&mut map);
            let (mut rn, mut rd, mut fn_, mut fd) = (0u64, 0u64, 0u64, 0u64);
            // safety map cells to odom
            let at = |x: f64, y: f64| {
                let (bx, by) = pose.inverse_transform(x, y);
                SAFETY_GRID.index(bx as f32, by as f32)
            };
            for (cell, (o, fr, fl)) in &batch {
                let (x, y) = ((cell.0 as f64 + 0.5) * 0.05, (cell.1 as f64 + 0.5) * 0.05);
                if *fr < 3 || *o < 60 || *fl > *o {
                    continue;
                }
                let (dx, dy) = pose.inverse_transform(x, y);
                if dx.abs() > 1.85 || dy.abs() > 1.85 {
                    continue;
                }
                rd += 1;
                let mut hit = false;
                for ix in -1..=1 {
                    for iy in -1..=1 {
                        if let Some(i) = at(x + ix as f64 * 0.05, y + iy as f64 * 0.05) {
                            if map.age[i] != 255 && map.occupancy[i] > 128 {
                                hit = true;
                            }
                        }
                    }
                }
                rn += u64::from(hit);
            }
            for i in 0..SAFETY_CELLS {
                if map.age[i] == 255 || map.occupancy[i] >= 90 {
                    continue;
                }
                fd += 1;
                let (bx, by) = SAFETY_GRID.centre(i / 80, i % 80);
                let (x, y) = pose.transform(bx as f64, by as f64);
                let cell = ((x / 0.05).floor() as i32, (y / 0.05).floor() as i32);
                if let Some((o, fr, fl)) = batch.get(&cell) {
                    if *fr >= 3 && *o >= 60 && *fl <= *o {
                        fn_ += 1;
                    }
                }
            }
            rows.push(format!("{n}: recall {rn}/{rd} false free {fn_}/{fd}"));
            rec_n += rn;
            rec_d += rd;
            ff_n += fn_;
            ff_d += fd;
        }
    }
    for row in rows.iter().step_by(4) {
        println!("{row}");
    }
    println!(
        "recall {:.4} ({rec_d}) false free {:.5} ({ff_d}) worst {worst:?} mean {:?}",
        rec_n as f64 / rec_d as f64,
        ff_n as f64 / ff_d as f64,
        total / 373
    );
}
