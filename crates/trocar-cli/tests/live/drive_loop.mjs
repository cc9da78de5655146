// Uses the report of `trocar teleop` as a reader would: watches the motion, turns sliders, drags with mouse, keys and finger.
// Prints what it saw as JSON; tests/live_loop.rs judges it. Arguments: playwright-core's folder, the browser, the report,
// a folder for downloads.
import { join } from "node:path";
import { download as downloaded, start } from "./browser.mjs";

const [modules, browserPath, report, folder] = process.argv.slice(2);
const browser = await start(modules, browserPath), { complaints, asked } = browser;
async function open(options) {
  const page = await browser.open(report, options);
  if (options.javaScriptEnabled !== false) await page.waitForSelector(".live-status", { timeout: 15000 });
  return page;
}
const download = (page, name) => downloaded(page, join(folder, name));

const seen = (page) => page.evaluate(() => {
  const nodes = [...document.querySelectorAll("[data-live]")];
  return {
    text: Object.fromEntries(nodes.map((node) => [node.dataset.live, node.textContent])),
    value: Object.fromEntries(nodes.map((node) => [node.dataset.live, node.dataset.value])),
    message: document.querySelector(".knob-message").textContent,
  };
});
async function field(page, id, text) {
  await page.locator(".knob", { has: page.locator("#knob-" + id) }).locator("input[type=number]").fill(text);
  await page.keyboard.press("Tab");
}
const resting = (page) => page.waitForFunction(() => {
  const now = document.querySelector(".strip-handle").getAttribute("aria-valuenow") + document.querySelector("[data-live=felt]").dataset.value;
  const same = globalThis.before === now ? (globalThis.count || 0) + 1 : 0;
  Object.assign(globalThis, { before: now, count: same });
  return same > 5;
}, null, { polling: 100, timeout: 20000 });

async function desktop() {
  const page = await open({ viewport: { width: 1100, height: 900 } });
  const steps = { start: await seen(page) };
  await download(page, "motion.csv");
  await field(page, "fraction", "0");
  await field(page, "delay", "0");
  steps.turned = await seen(page);
  await download(page, "turned.csv");
  await field(page, "delay", "10");
  steps.unstable = await seen(page);
  await field(page, "delay", "-3");
  steps.refused = await seen(page);
  await page.locator(".knob-bar button").click();
  await page.locator(".knob-choice select").selectOption("wave");
  steps.wave = await seen(page);
  await download(page, "wave.csv");
  await page.locator(".knob-bar button").click();
  steps.reset = await seen(page);

  await page.locator(".live-modes label", { hasText: "Drag" }).click();
  await page.locator(".strip").scrollIntoViewIfNeeded();
  const [strip, handle] = [await page.locator(".strip").boundingBox(), await page.locator(".strip-handle").boundingBox()];
  const y = handle.y + handle.height / 2;
  await page.mouse.move(handle.x + handle.width / 2, y);
  await page.mouse.down();
  for (const part of [0.6, 0.3, 0.62]) { await page.mouse.move(strip.x + part * strip.width, y, { steps: 12 }); await page.waitForTimeout(150); }
  await page.mouse.up();
  await resting(page);
  steps.dragged = await seen(page);
  await download(page, "dragged.csv");
  await page.locator(".tools button", { hasText: "Start anew" }).click();
  await page.locator(".strip-handle").focus();
  const at = async () => Number(await page.locator(".strip-handle").getAttribute("aria-valuenow"));
  steps.beforeKeys = await at();
  for (let k = 0; k < 5; k++) await page.keyboard.press("ArrowRight");
  await resting(page);
  steps.afterKeys = await at();
  return steps;
}

// A finger on a telephone with reduced motion.
async function telephone() {
  const page = await open({ viewport: { width: 360, height: 740 }, hasTouch: true, isMobile: true, reducedMotion: "reduce", colorScheme: "dark" });
  await page.locator(".strip").scrollIntoViewIfNeeded();
  const handle = await page.locator(".strip-handle").boundingBox(), session = await page.context().newCDPSession(page);
  const at = async () => Number(await page.locator(".strip-handle").getAttribute("aria-valuenow"));
  const touch = (type, x) => session.send("Input.dispatchTouchEvent",
    { type, touchPoints: type === "touchEnd" ? [] : [{ x, y: handle.y + handle.height / 2 }] });
  const from = handle.x + handle.width / 2;
  await touch("touchStart", from);
  const before = await at();
  for (let k = 1; k <= 10; k++) { await touch("touchMove", from + 8 * k); await page.waitForTimeout(30); }
  await touch("touchEnd");
  await resting(page);
  return {
    before, after: await at(),
    overflow: await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth),
  };
}

async function paper() {
  const page = await open({ viewport: { width: 672, height: 1000 } });
  await page.emulateMedia({ media: "print" });
  return {
    notice: await page.locator(".on-paper").isVisible(), live: await page.locator(".live").isVisible(),
    overflow: await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth),
  };
}

async function without(options) {
  const page = await open(options);
  return { absent: await page.locator(".live-absent").isVisible(), figures: await page.locator("figure svg").count() };
}

const result = {
  desktop: await desktop(), telephone: await telephone(), paper: await paper(), complaints: [...complaints], asked,
  noScript: await without({ javaScriptEnabled: false }),
};
await browser.close();
console.log(JSON.stringify(result));
