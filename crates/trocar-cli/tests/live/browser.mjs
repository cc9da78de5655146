// A browser without network in which the drivers of this folder use pages as a reader would, and what it complains of and asks for.
import { createRequire } from "node:module";
import { join } from "node:path";
import { pathToFileURL } from "node:url";

// `modules` is playwright-core's folder. Only what a page asks for beyond itself counts as asked; `prepare` runs before its scripts.
export async function start(modules, executablePath) {
  const { chromium } = createRequire(join(modules, "package.json"))("playwright-core");
  const args = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"];
  const browser = await chromium.launch({ executablePath, args });
  const complaints = [], asked = [];

  async function open(path, { prepare, ...options } = {}) {
    const url = pathToFileURL(path).href, context = await browser.newContext({ acceptDownloads: true, ...options });
    await context.setOffline(true);
    const page = await context.newPage();
    page.on("request", (request) => { if (request.url() !== url && !/^(data|blob):/.test(request.url())) asked.push(request.url()); });
    page.on("console", (message) => { if (message.type() === "error") complaints.push(message.text()); });
    page.on("pageerror", (error) => complaints.push(error.message));
    if (prepare) await page.addInitScript(prepare);
    await page.goto(url);
    return page;
  }
  return { open, complaints, asked, close: () => browser.close() };
}

// Saves the motion and the force that the page shows.
export async function download(page, file) {
  const [saved] = await Promise.all([page.waitForEvent("download"), page.locator(".live-view .tools button", { hasText: "CSV" }).click()]);
  await saved.saveAs(file);
}
