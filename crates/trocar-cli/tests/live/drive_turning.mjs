// Moves and turns the instrument of a live model as a reader would: keys on the handle, then keys on the slider of the angle. Prints what it saw
// as JSON; tests/live_turning.rs judges it. Arguments: playwright-core's folder, the browser, the page, a file for the motion.
import { download, start } from "./browser.mjs";

const [modules, executablePath, report, file] = process.argv.slice(2);
const browser = await start(modules, executablePath), { complaints, asked } = browser;

const seen = (page) => page.evaluate(() => {
  const number = (name) => Number(document.querySelector(`[data-live=${name}]`).dataset.value);
  const [ellipse] = document.getElementById("live").live.round.panel.series, largest = (values) => Math.max(...values);
  return { force: number("force"), torque: number("torque"), ellipse: [largest(ellipse.x), largest(ellipse.y)],
    overflow: document.documentElement.scrollWidth - document.documentElement.clientWidth };
});
async function settled(page) {
  let last;
  for (let now = -1; now !== last; last = now, now = JSON.stringify(await seen(page)), await page.waitForTimeout(400));
  return seen(page);
}

async function open(options) {
  const page = await browser.open(report, options);
  await page.waitForSelector(".live-body", { timeout: 15000 });
  return page;
}

const page = await open({ viewport: { width: 1100, height: 900 } });
await page.locator(".strip-handle").focus();
for (let k = 0; k < 4; k++) { await page.keyboard.press("PageUp"); await page.waitForTimeout(100); }
const moved = await settled(page);
await page.locator("#live-turn").focus();
for (let k = 0; k < 18; k++) await page.keyboard.press("ArrowRight");
const turned = await settled(page);
await download(page, file);
const telephone = await seen(await open({ viewport: { width: 390, height: 800 }, hasTouch: true, isMobile: true }));
await browser.close();
console.log(JSON.stringify({ moved, turned, telephone, complaints, asked }));
