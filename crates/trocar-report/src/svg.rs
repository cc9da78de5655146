//! Completes kuva's SVG: printed size, scaling, and a description for screen readers.

use super::document::Figure;
use super::draw::PIXELS_PER_MILLIMETRE;
use super::html::escape;

/// A drawn figure: the body of the SVG without its opening tag, and its size in scene pixels.
pub(super) struct Drawing {
    body: String,
    width: f64,
    height: f64,
    font: String,
}

impl Drawing {
    /// Renders `scene`; `None` if kuva's output does not start with a tag.
    pub(super) fn new(scene: &kuva::render::render::Scene) -> Option<Self> {
        let svg = kuva::backend::svg::SvgBackend::new().render_scene(scene);
        let (_, body) = svg.split_once('>')?;
        let font = scene.font_family.clone().unwrap_or_default();
        Some(Self { body: body.to_owned(), width: scene.width, height: scene.height, font })
    }

    /// A separate file, sized in millimetres.
    pub(super) fn file(&self, figure: &Figure) -> String {
        let [width, height] =
            [self.width, self.height].map(|pixels| pixels / PIXELS_PER_MILLIMETRE);
        let size = format!(
            " xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\""
        );
        self.with_opening_tag(figure, &size)
    }

    /// A part of an HTML page; the style sheet defines its width.
    pub(super) fn inline(&self, figure: &Figure) -> String {
        self.with_opening_tag(figure, "")
    }

    fn with_opening_tag(&self, figure: &Figure, size: &str) -> String {
        let Self { body, width, height, font } = self;
        let (id, title, caption) = (&figure.id, escape(&figure.title), escape(&figure.caption));
        format!(
            "<svg{size} viewBox=\"0 0 {width} {height}\" role=\"img\" aria-labelledby=\"figure-{id}-title figure-{id}-text\" \
             font-family=\"{font}\" fill=\"#1a1a1a\"><title id=\"figure-{id}-title\">{title}</title>\
             <desc id=\"figure-{id}-text\">{caption}</desc>{body}"
        )
    }
}
