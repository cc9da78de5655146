// Uses the seal of the book's first page as a reader would: a drag, keys, a finger, the button. Prints what it saw as JSON; tests/live_seal.rs
// judges it. Arguments: playwright-core's folder, the browser, the page, the page that plays, a file for the motion.
import { writeFileSync } from "node:fs";
import { start } from "./browser.mjs";

const [modules, executablePath, dragged, played, file] = process.argv.slice(2);
const browser = await start(modules, executablePath), { complaints, asked } = browser;

async function open(path, options) {
  const page = await browser.open(path, options);
  if (options.javaScriptEnabled !== false) await page.waitForSelector(".moving-seal[data-live]", { timeout: 15000 });
  return page;
}

const seen = (page) => page.evaluate(() => ({
  lip: document.querySelector("path.seal-lip").getAttribute("d"),
  says: Object.fromEntries([...document.querySelectorAll("[data-seal]")].map((node) => [node.dataset.seal, node.textContent])),
  force: Number(document.querySelector("[data-seal=force]").dataset.value),
  position: Number(document.querySelector("[data-seal=position]").dataset.value),
  overflow: document.documentElement.scrollWidth - document.documentElement.clientWidth,
}));
async function settled(page) {
  let last;
  for (let now = -1; now !== last; last = now, now = (await seen(page)).position, await page.waitForTimeout(200));
  return seen(page);
}

async function desktop() {
  const page = await open(dragged, { viewport: { width: 900, height: 900 } });
  const start = await seen(page), box = await page.locator(".seal-section").boundingBox();
  const y = box.y + 0.43 * box.height;
  await page.mouse.move(box.x + 0.5 * box.width, y);
  await page.mouse.down();
  for (const part of [0.68, 0.35, 0.4]) {
    await page.mouse.move(box.x + part * box.width, y, { steps: 15 });
    await page.waitForTimeout(150);
  }
  await page.mouse.up();
  const after = await settled(page);
  writeFileSync(file, await page.evaluate(() => document.querySelector(".moving-seal").seal.motion.csv()));
  await page.locator(".seal-section").focus();
  for (let k = 0; k < 5; k++) await page.keyboard.press("ArrowRight");
  const byKeys = await settled(page);
  await page.locator(".seal-tools button").click();
  await page.waitForTimeout(300);
  const first = await seen(page);
  await page.waitForTimeout(300);
  const playing = [first.position, (await seen(page)).position];
  await page.locator(".seal-tools button").click();
  return { start, after, byKeys, playing };
}

async function telephone() {
  const page = await open(dragged, { viewport: { width: 390, height: 800 }, hasTouch: true, isMobile: true, colorScheme: "dark" });
  const before = await seen(page), session = await page.context().newCDPSession(page);
  const box = await page.locator(".seal-section").boundingBox(), y = box.y + 0.43 * box.height, from = box.x + 0.5 * box.width;
  const touch = (type, x) => session.send("Input.dispatchTouchEvent", { type, touchPoints: type === "touchEnd" ? [] : [{ x, y }] });
  await touch("touchStart", from);
  for (let k = 1; k <= 10; k++) { await touch("touchMove", from - 5 * k); await page.waitForTimeout(20); }
  await touch("touchEnd");
  return { before, after: await settled(page) };
}

async function plays(reducedMotion) {
  const page = await open(played, { viewport: { width: 900, height: 900 }, reducedMotion });
  const first = await seen(page);
  await page.waitForTimeout(500);
  return (await seen(page)).position !== first.position;
}

const withoutScript = await without();
async function without() {
  const page = await open(dragged, { javaScriptEnabled: false });
  return { lip: await page.locator("path.seal-lip").first().getAttribute("d"), force: await page.locator("[data-seal=force]").textContent() };
}
const result = { withoutScript, desktop: await desktop(), telephone: await telephone(),
  plays: [await plays("no-preference"), await plays("reduce")], complaints, asked };
await browser.close();
console.log(JSON.stringify(result));
