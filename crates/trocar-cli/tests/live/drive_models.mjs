// Opens live models as the book shows them, and moves each by the keyboard. Prints the force before and after, and what the page says of the
// values, as JSON; tests/model_pages.rs judges it. Arguments: playwright-core's folder, the browser, the pages.
import { start } from "./browser.mjs";

const [modules, browserPath, ...pages] = process.argv.slice(2);
const browser = await start(modules, browserPath);

const seen = [];
for (const path of pages) {
  const page = await browser.open(path, { viewport: { width: 900, height: 1100 } });
  const shown = page.locator("[data-live=force][data-value]");
  await shown.waitFor({ timeout: 30000 });
  const force = async () => Number(await shown.getAttribute("data-value"));
  const before = await force();
  await page.locator(".strip-handle").focus();
  for (let k = 0; k < 5; k++) await page.keyboard.press("ArrowRight");
  await page.waitForFunction(() => Number(document.querySelector("[data-live=force]").dataset.value) > 0, null, { timeout: 30000 });
  seen.push({ before, after: await force(), message: await page.locator(".knob-message").textContent() });
  await page.close();
}
await browser.close();
console.log(JSON.stringify(seen));
