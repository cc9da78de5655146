use std::hint::black_box;
use std::time::Instant;
use trocar_model::batch::{Batch, Forces, Lanes, Squares, blocks};
use trocar_model::{Element, ElementParams, SlidingFriction};

fn elements(count: usize, viscous: f64) -> Vec<Element> {
    let base = ElementParams::plausible_10_5_mm().unwrap();
    (0..count)
        .map(|k| {
            let x = k as f64 / count as f64;
            let s = |f: SlidingFriction| SlidingFriction { viscous_damping: viscous * (1.0 + x), ..f };
            let e =
                Element::new(ElementParams { insertion: s(base.insertion), withdrawal: s(base.withdrawal), ..base })
                    .unwrap();
            let seal: trocar_model::Seal = e.into();
            let half = base.deformation.half_width() * (0.7 + 0.6 * x);
            let trocar_model::Seal::Ems(st) = seal.tuned(&[half]).unwrap() else { unreachable!() };
            *st.first()
        })
        .collect()
}
fn motion(samples: usize) -> Vec<(f64, f64)> {
    let p = |k: usize| {
        let t = k as f64 * 1e-3;
        let phase = (t / 4.0).fract();
        let stroke = if phase < 0.4 {
            0.04 * phase / 0.4
        } else if phase < 0.5 {
            0.04
        } else if phase < 0.9 {
            0.04 * (0.9 - phase) / 0.4
        } else {
            0.0
        };
        stroke + if t > samples as f64 * 5e-4 { 5e-3 * (1.0 - (5.0 * t).cos()) + 2e-4 * (56.5 * t).sin() } else { 0.0 }
    };
    (1..=samples).map(|k| (p(k) - p(k - 1), 1e-3)).collect()
}
fn median(mut f: impl FnMut() -> f64) -> f64 {
    let mut v: Vec<f64> = (0..15).map(|_| f()).collect();
    v.sort_by(f64::total_cmp);
    v[7]
}
fn main() {
    for viscous in [0.0, 5.0] {
        for count in [1, 4, 8, 16, 64, 1024] {
            let samples = if count > 64 { 4000 } else { 40_000 };
            let e = elements(count, viscous);
            let m = motion(samples);
            let measured = vec![0.5; samples];
            let mut states: Vec<_> = e.iter().map(|e| e.rest_state(0.0)).collect();
            let mut places = vec![Lanes::EMPTY; blocks(count)];
            let mut sums = vec![0.0; count];
            let mut out = vec![0.0; count * samples];
            let work = (count * samples) as f64;
            let sq = median(|| {
                let mut b = Batch::new(&e, &mut states, &mut places).unwrap();
                let t = Instant::now();
                b.run(m.iter().copied(), &mut Squares::new(&measured, &mut sums));
                black_box(&sums);
                t.elapsed().as_secs_f64() * 1e9 / work
            });
            let fo = median(|| {
                let mut b = Batch::new(&e, &mut states, &mut places).unwrap();
                let t = Instant::now();
                b.run(m.iter().copied(), &mut Forces::new(count, &mut out));
                black_box(&out);
                t.elapsed().as_secs_f64() * 1e9 / work
            });
            let st = median(|| {
                let mut b = Batch::new(&e, &mut states, &mut places).unwrap();
                let t = Instant::now();
                for (d, p) in &m {
                    b.step(*d, *p);
                    black_box(b.force(0));
                }
                t.elapsed().as_secs_f64() * 1e9 / work
            });
            let sc = median(|| {
                let t = Instant::now();
                for (e, s) in e.iter().zip(&mut states) {
                    for (d, p) in &m {
                        black_box(e.step(s, *d, *p));
                    }
                }
                t.elapsed().as_secs_f64() * 1e9 / work
            });
            println!("beta {viscous} seals {count:5}: squares {sq:6.2} forces {fo:6.2} step {st:6.2} scalar {sc:6.2}");
        }
    }
}
