// Uses a report as a reader would: sliders, keys, a drag, a touch, a drawing. Prints what it saw as JSON; tests/live.rs
// judges it. Arguments: playwright-core's folder, the browser, the report, a folder for downloads.
import { join } from "node:path";
import { download as downloaded, start } from "./browser.mjs";

const [modules, browserPath, report, folder] = process.argv.slice(2);
const browser = await start(modules, browserPath), { complaints, asked } = browser;
const open = (options) => browser.open(report, options);
const download = (page, name) => downloaded(page, join(folder, name));

// What stands on the page: texts, numbers behind them, parameters.
const seen = (page) => page.evaluate(() => {
  const nodes = [...document.querySelectorAll("[data-live]")];
  return {
    text: Object.fromEntries(nodes.map((node) => [node.dataset.live, node.parentNode.hidden ? "" : node.textContent])),
    value: Object.fromEntries(nodes.map((node) => [node.dataset.live, node.dataset.value])),
    knobs: Object.fromEntries([...document.querySelectorAll(".knob")].map((row) =>
      [row.querySelector("input[type=range]").id.replace("knob-", ""), row.dataset.value])),
  };
});
const frames = (page, count) => page.evaluate((left) => new Promise((done) => {
  const next = () => (left-- > 0 ? requestAnimationFrame(next) : done());
  next();
}), count);
const mode = (page, words) => page.locator(".live-modes label", { hasText: words }).click();
async function settled(page) {
  let last;
  for (let now = ""; now !== last; last = now, now = (await seen(page)).value.force, await page.waitForTimeout(150));
}

// A mouse on the handle: to and fro along the strip.
async function drag(page) {
  await page.locator(".strip").scrollIntoViewIfNeeded();
  const [strip, handle] = [await page.locator(".strip").boundingBox(), await page.locator(".strip-handle").boundingBox()];
  const y = handle.y + handle.height / 2, from = handle.x + handle.width / 2;
  await page.mouse.move(from, y);
  await page.mouse.down();
  for (const part of [0.75, 0.3, 0.6]) {
    await page.mouse.move(strip.x + part * strip.width, y, { steps: 12 });
    await frames(page, 5);
  }
  await page.mouse.up();
  await settled(page);
}

async function desktop() {
  const page = await open({ viewport: { width: 1100, height: 900 } });
  await page.waitForSelector(".live-body", { timeout: 15000 });
  await page.locator("#live").scrollIntoViewIfNeeded();
  await frames(page, 2);
  const steps = { start: await seen(page) };
  await download(page, "recorded.csv");
  await page.locator("#knob-1").focus();
  for (let k = 0; k < 60; k++) await page.keyboard.press("ArrowRight");
  steps.turned = await seen(page);
  await download(page, "recorded-turned.csv");
  await page.locator(".knob", { has: page.locator("#knob-0") }).locator("input[type=number]").fill("-5");
  await page.keyboard.press("Tab");
  steps.impossible = { ...(await seen(page)), message: await page.locator(".knob-message").textContent() };
  await page.locator(".knob-bar button").click();
  steps.reset = await seen(page);

  await drag(page);
  steps.dragged = await seen(page);
  await download(page, "dragged.csv");
  await page.locator("#knob-1").focus();
  await page.keyboard.press("End");
  steps.draggedTurned = await seen(page);
  await download(page, "dragged-turned.csv");
  await page.locator(".knob-bar button").click();
  await page.locator(".tools button", { hasText: "Start anew" }).click();
  await page.locator(".strip-handle").focus();
  steps.beforeKeys = Number(await page.locator(".strip-handle").getAttribute("aria-valuenow"));
  for (let k = 0; k < 5; k++) await page.keyboard.press("ArrowLeft");
  await settled(page);
  steps.afterKeys = Number(await page.locator(".strip-handle").getAttribute("aria-valuenow"));

  await mode(page, "Draw");
  await page.locator(".pen").scrollIntoViewIfNeeded();
  const box = await page.locator(".pen").boundingBox();
  await page.mouse.move(box.x + 4, box.y + 0.5 * box.height);
  await page.mouse.down();
  for (let k = 1; k <= 60; k++)
    await page.mouse.move(box.x + 4 + (k / 60) * 0.8 * box.width, box.y + (0.5 - 0.4 * Math.sin(k / 8)) * box.height);
  await page.mouse.up();
  await frames(page, 3);
  steps.drawn = await seen(page);
  await download(page, "drawn.csv");
  await page.screenshot({ path: join(folder, "drawn.png") });
  return steps;
}

// A finger on a telephone with reduced motion.
async function telephone() {
  const page = await open({ viewport: { width: 360, height: 740 }, hasTouch: true, isMobile: true, reducedMotion: "reduce", colorScheme: "dark" });
  await page.waitForSelector(".live-body", { timeout: 15000 });
  await page.locator(".strip").scrollIntoViewIfNeeded();
  const handle = await page.locator(".strip-handle").boundingBox(), session = await page.context().newCDPSession(page);
  const before = Number(await page.locator(".strip-handle").getAttribute("aria-valuenow"));
  const touch = (type, x) => session.send("Input.dispatchTouchEvent",
    { type, touchPoints: type === "touchEnd" ? [] : [{ x, y: handle.y + handle.height / 2 }] });
  const from = handle.x + handle.width / 2;
  await touch("touchStart", from);
  for (let k = 1; k <= 10; k++) { await touch("touchMove", from - 8 * k); await frames(page, 1); }
  await touch("touchEnd");
  await settled(page);
  return {
    before, after: Number(await page.locator(".strip-handle").getAttribute("aria-valuenow")),
    overflow: await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth),
    player: await page.locator(".tools button", { hasText: "Play" }).count() && await page.locator(".live-view .tools button").first().isVisible(),
  };
}

// The page as it is printed: A4 less its margins is 178 mm wide, 672 px.
async function paper() {
  const page = await open({ viewport: { width: 672, height: 1000 } });
  await page.waitForSelector(".live-body", { timeout: 15000 });
  const notice = page.locator(".on-paper"), onScreen = await notice.isVisible();
  await page.emulateMedia({ media: "print" });
  return {
    onScreen, notice: await notice.isVisible(), live: await page.locator(".live").isVisible(),
    overflow: await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth),
    tables: await page.evaluate(() => [...document.querySelectorAll("table")].map((table) => table.checkVisibility())),
  };
}

async function without(options) {
  const page = await open(options);
  return { absent: await page.locator(".live-absent").isVisible(), figures: await page.locator("figure svg").count() };
}

const result = {
  desktop: await desktop(),
  telephone: await telephone(),
  paper: await paper(),
  complaints: [...complaints],
  asked,
  noScript: await without({ javaScriptEnabled: false }),
  noWebAssembly: await without({ prepare: () => { delete globalThis.WebAssembly; } }),
};
await browser.close();
console.log(JSON.stringify(result));
