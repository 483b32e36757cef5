<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>ChoicePanel</name>
    <message>
        <source>Enter the engineer&apos;s PIN</source>
        <translation>输入工程师密码</translation>
    </message>
    <message>
        <source>Set the engineer&apos;s PIN</source>
        <translation>设置工程师密码</translation>
    </message>
    <message>
        <source>Reset</source>
        <translation>恢复</translation>
    </message>
    <message>
        <source>Back to the product&apos;s values of this stage</source>
        <translation>本阶段恢复为产品的设定值</translation>
    </message>
    <message>
        <source>Save to product</source>
        <translation>存入产品</translation>
    </message>
    <message>
        <source>Schedule: {0}</source>
        <translation>流程参数：{0}</translation>
    </message>
</context>
<context>
    <name>CycleView</name>
    <message>
        <source>Phases of the cycle, to scale</source>
        <translation>节拍各环节（按比例）</translation>
    </message>
    <message>
        <source>Phases except the stages, to scale</source>
        <translation>标定阶段以外的各环节（按比例）</translation>
    </message>
    <message>
        <source>Everything except the stages</source>
        <translation>标定阶段以外</translation>
    </message>
    <message>
        <source>Cycle: {0:.1f} s</source>
        <translation>节拍：{0:.1f} s</translation>
    </message>
    <message>
        <source>All stages</source>
        <translation>全部标定阶段</translation>
    </message>
    <message>
        <source>Everything else</source>
        <translation>其余合计</translation>
    </message>
</context>
<context>
    <name>DesignAnswer</name>
    <message>
        <source>Save as product…</source>
        <translation>存为产品…</translation>
    </message>
    <message>
        <source>Copy schedule</source>
        <translation>复制流程</translation>
    </message>
    <message>
        <source>Export</source>
        <translation>导出</translation>
    </message>
    <message>
        <source>Saves a product with this schedule in place of its stages</source>
        <translation>另存为产品，以此流程代替原有阶段</translation>
    </message>
    <message>
        <source>Unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>σ planned</source>
        <translation>预期 σ</translation>
    </message>
    <message>
        <source>σ limit</source>
        <translation>σ 限差</translation>
    </message>
    <message>
        <source>σ / limit</source>
        <translation>σ/限差</translation>
    </message>
    <message>
        <source>Condition</source>
        <translation>条件</translation>
    </message>
    <message>
        <source>Reached after</source>
        <translation>达到限差用时</translation>
    </message>
    <message>
        <source>Largest σ / target then</source>
        <translation>届时最大 σ/目标</translation>
    </message>
    <message>
        <source>It moves most</source>
        <translation>受影响最大的参数</translation>
    </message>
    <message>
        <source>Duration</source>
        <translation>时长</translation>
    </message>
    <message>
        <source>Hidden effects</source>
        <translation>隐藏误差</translation>
    </message>
    <message>
        <source>Computing the path</source>
        <translation>正在计算路径</translation>
    </message>
    <message>
        <source>Effect</source>
        <translation>误差</translation>
    </message>
    <message>
        <source>Hidden up to</source>
        <translation>可隐藏至</translation>
    </message>
    <message>
        <source>by, σ</source>
        <translation>影响，σ</translation>
    </message>
    <message>
        <source>Path</source>
        <translation>路径</translation>
    </message>
    <message>
        <source>Parameters</source>
        <translation>参数</translation>
    </message>
    <message>
        <source>Robustness</source>
        <translation>稳健性</translation>
    </message>
</context>
<context>
    <name>DesignForm</name>
    <message>
        <source>Design</source>
        <translation>设计</translation>
    </message>
    <message>
        <source>Advanced</source>
        <translation>高级</translation>
    </message>
    <message>
        <source>Margin</source>
        <translation>裕度</translation>
    </message>
    <message>
        <source>Every σ must fall below this fraction of its limit</source>
        <translation>每个标准差须小于限差的这一比例</translation>
    </message>
    <message>
        <source>Duration, min</source>
        <translation>时长，min</translation>
    </message>
    <message>
        <source>Duration of the stage</source>
        <translation>阶段时长</translation>
    </message>
    <message>
        <source>Search for, s</source>
        <translation>搜索时间，s</translation>
    </message>
    <message>
        <source>A longer search finds shorter schedules; usual: one to three minutes</source>
        <translation>搜索越久，流程越短；默认一到三分钟</translation>
    </message>
    <message>
        <source>Goal</source>
        <translation>目标</translation>
    </message>
    <message>
        <source>Rate, °/s</source>
        <translation>速率，°/s</translation>
    </message>
    <message>
        <source>Automatic: 85 % of the table&apos;s largest rate, at most 80 % of the gyros&apos; range</source>
        <translation>自动：转台最大速率的 85 %，且不超过陀螺量程的 80 %</translation>
    </message>
    <message>
        <source>Acceleration, °/s²</source>
        <translation>加速度，°/s²</translation>
    </message>
    <message>
        <source>Automatic: 75 % of the table&apos;s largest acceleration</source>
        <translation>自动：转台最大加速度的 75 %</translation>
    </message>
    <message>
        <source>Seed</source>
        <translation>随机种子</translation>
    </message>
    <message>
        <source>Another number makes another random search</source>
        <translation>换一个数就是另一次随机搜索</translation>
    </message>
    <message>
        <source>Computed without moving the table; takes one to three minutes</source>
        <translation>只计算，转台不动；需一到三分钟</translation>
    </message>
    <message>
        <source>Shortest that reaches the limits</source>
        <translation>满足限差的最短流程</translation>
    </message>
    <message>
        <source>Smallest σ in a given time</source>
        <translation>给定时长内标准差最小</translation>
    </message>
    <message>
        <source>Shortest as good as the present stages</source>
        <translation>与现有阶段同等精度的最短流程</translation>
    </message>
    <message>
        <source>usual</source>
        <translation>默认</translation>
    </message>
    <message>
        <source>automatic</source>
        <translation>自动</translation>
    </message>
</context>
<context>
    <name>DesignView</name>
    <message>
        <source>Stop with the best so far</source>
        <translation>以当前最优结束</translation>
    </message>
    <message>
        <source>The product was not saved</source>
        <translation>产品没有保存</translation>
    </message>
    <message>
        <source>The path cannot be drawn</source>
        <translation>无法绘制路径</translation>
    </message>
    <message>
        <source>Keep the present product</source>
        <translation>保留当前产品</translation>
    </message>
    <message>
        <source>Select {0}</source>
        <translation>选用 {0}</translation>
    </message>
    <message>
        <source>Save the design</source>
        <translation>保存设计结果</translation>
    </message>
</context>
<context>
    <name>EngineerPage</name>
    <message>
        <source>Show an earlier result or log</source>
        <translation>查看以前的标定结果或数据记录</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>Save to product</source>
        <translation>存入产品</translation>
    </message>
    <message>
        <source>The log could not be solved again</source>
        <translation>数据记录无法重新解算</translation>
    </message>
    <message>
        <source>Design</source>
        <translation>设计</translation>
    </message>
    <message>
        <source>Cycle</source>
        <translation>节拍</translation>
    </message>
    <message>
        <source>The product was not saved</source>
        <translation>产品没有保存</translation>
    </message>
    <message>
        <source>Resume</source>
        <translation>继续</translation>
    </message>
    <message>
        <source>Begin again</source>
        <translation>从头再来</translation>
    </message>
    <message>
        <source>All clear, start</source>
        <translation>已确认，开始</translation>
    </message>
    <message>
        <source>Open a result or a log</source>
        <translation>打开标定结果或数据记录</translation>
    </message>
    <message>
        <source>Results and logs (*.json *.h5 *.csv *.csv.gz)</source>
        <translation>标定结果和数据记录 (*.json *.h5 *.csv *.csv.gz)</translation>
    </message>
    <message>
        <source>All files (*)</source>
        <translation>所有文件 (*)</translation>
    </message>
    <message>
        <source>This file cannot be opened</source>
        <translation>这个文件打不开</translation>
    </message>
    <message>
        <source>Preview</source>
        <translation>预览</translation>
    </message>
    <message>
        <source>Parameters</source>
        <translation>参数</translation>
    </message>
    <message>
        <source>Innovations</source>
        <translation>新息</translation>
    </message>
    <message>
        <source>Residuals</source>
        <translation>残差</translation>
    </message>
    <message>
        <source>Observability</source>
        <translation>可观测性</translation>
    </message>
    <message>
        <source>Registers</source>
        <translation>寄存器</translation>
    </message>
    <message>
        <source>Open</source>
        <translation>打开</translation>
    </message>
</context>
<context>
    <name>FrontPlot</name>
    <message>
        <source>duration, min</source>
        <translation>时长，min</translation>
    </message>
    <message>
        <source>largest σ / limit</source>
        <translation>最大 σ/限差</translation>
    </message>
    <message>
        <source>duration, s</source>
        <translation>时长，s</translation>
    </message>
    <message>
        <source>● found during the search</source>
        <translation>● 搜索中找到</translation>
    </message>
    <message>
        <source>◆ chosen</source>
        <translation>◆ 选定</translation>
    </message>
    <message>
        <source>– – margin {0:.2f}</source>
        <translation>– – 裕度 {0:.2f}</translation>
    </message>
</context>
<context>
    <name>HeatMap</name>
    <message>
        <source>{0} after step {1}: {2:.3g} times better known than before the stage</source>
        <translation>{0}，第 {1} 步之后：比本阶段之前准 {2:.3g} 倍</translation>
    </message>
    <message>
        <source>east</source>
        <translation>东</translation>
    </message>
    <message>
        <source>{0} after step {1}: not better known than before</source>
        <translation>{0}，第 {1} 步之后：还没有比原来更准</translation>
    </message>
    <message>
        <source>north</source>
        <translation>北</translation>
    </message>
    <message>
        <source>up</source>
        <translation>天</translation>
    </message>
    <message>
        <source>attitude</source>
        <translation>姿态</translation>
    </message>
    <message>
        <source>prior σ / σ after the step, ×</source>
        <translation>先验 σ / 各步之后的 σ，倍</translation>
    </message>
    <message>
        <source>Step {0}: {1}</source>
        <translation>第 {0} 步：{1}</translation>
    </message>
    <message>
        <source>velocity</source>
        <translation>速度</translation>
    </message>
</context>
<context>
    <name>InnovationsView</name>
    <message>
        <source>Stage</source>
        <translation>阶段</translation>
    </message>
    <message>
        <source>Verdict</source>
        <translation>结论</translation>
    </message>
    <message>
        <source>time in the stage, min</source>
        <translation>阶段内时间，min</translation>
    </message>
    <message>
        <source>{0} observations, {1:.2f} % beyond ±3 σ (0.27 % expected)</source>
        <translation>{0} 次观测，超出 ±3 σ 的占 {1:.2f} %（理论 0.27 %）</translation>
    </message>
    <message>
        <source>east, σ</source>
        <translation>东，σ</translation>
    </message>
    <message>
        <source>north, σ</source>
        <translation>北，σ</translation>
    </message>
    <message>
        <source>up, σ</source>
        <translation>天，σ</translation>
    </message>
    <message>
        <source>Mean NIS</source>
        <translation>NIS 均值</translation>
    </message>
    <message>
        <source>Expected</source>
        <translation>期望区间</translation>
    </message>
</context>
<context>
    <name>MotionPlot</name>
    <message>
        <source>outer, °</source>
        <translation>外框，°</translation>
    </message>
    <message>
        <source>inner, °</source>
        <translation>内框，°</translation>
    </message>
    <message>
        <source>time, min</source>
        <translation>时间，min</translation>
    </message>
    <message>
        <source>time, s</source>
        <translation>时间，s</translation>
    </message>
</context>
<context>
    <name>ObservabilityView</name>
    <message>
        <source>Stage</source>
        <translation>阶段</translation>
    </message>
    <message>
        <source>No observability to show</source>
        <translation>没有可观测性数据</translation>
    </message>
    <message>
        <source>Only stages solved by the filter report it: the excitation and the azimuth flips.</source>
        <translation>只有滤波解算的阶段才有：三轴激励和方位翻转。</translation>
    </message>
    <message>
        <source>{0}: after step</source>
        <translation>{0}：各步之后</translation>
    </message>
    <message>
        <source>Not determined by this stage: {0}</source>
        <translation>本阶段无法确定：{0}</translation>
    </message>
    <message>
        <source>Every state is determined by this stage.</source>
        <translation>本阶段能确定全部状态。</translation>
    </message>
</context>
<context>
    <name>Parts</name>
    <message>
        <source>What to calibrate</source>
        <translation>标定内容</translation>
    </message>
    <message>
        <source>Scale factors</source>
        <translation>刻度系数</translation>
    </message>
    <message>
        <source>Installation matrix and lever arms</source>
        <translation>安装误差矩阵和杆臂</translation>
    </message>
    <message>
        <source>Biases</source>
        <translation>零偏</translation>
    </message>
    <message>
        <source>or single stages, in this order:</source>
        <translation>或单选阶段，按以下次序：</translation>
    </message>
    <message>
        <source>A choice of parts holds for one run.</source>
        <translation>所选部分仅对一次标定有效。</translation>
    </message>
</context>
<context>
    <name>PathPlot</name>
    <message>
        <source>planned</source>
        <translation>计划</translation>
    </message>
    <message>
        <source>reserve</source>
        <translation>备用</translation>
    </message>
</context>
<context>
    <name>PreviewView</name>
    <message>
        <source>Preview</source>
        <translation>预览</translation>
    </message>
    <message>
        <source>{0} in all, {1} moves</source>
        <translation>共 {0}，转动 {1} 次</translation>
    </message>
    <message>
        <source>{0}; the choice has changed since, preview again</source>
        <translation>{0}；选择已改变，请重新预览</translation>
    </message>
    <message>
        <source>σ target</source>
        <translation>σ 目标</translation>
    </message>
    <message>
        <source>Unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>σ before</source>
        <translation>原有 σ</translation>
    </message>
    <message>
        <source>σ limit</source>
        <translation>σ 限差</translation>
    </message>
    <message>
        <source>Expected</source>
        <translation>预期</translation>
    </message>
</context>
<context>
    <name>RegistersView</name>
    <message>
        <source>Address</source>
        <translation>地址</translation>
    </message>
    <message>
        <source>Unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>Old</source>
        <translation>原值</translation>
    </message>
    <message>
        <source>stored as</source>
        <translation>存储值</translation>
    </message>
    <message>
        <source>New</source>
        <translation>新值</translation>
    </message>
    <message>
        <source>Change</source>
        <translation>变化</translation>
    </message>
    <message>
        <source>Read the unit</source>
        <translation>读取产品</translation>
    </message>
    <message>
        <source>Write to the unit</source>
        <translation>写入产品</translation>
    </message>
    <message>
        <source>Two engineers confirm the registers of unit {0}</source>
        <translation>由两位工程师确认产品 {0} 的寄存器写入</translation>
    </message>
    <message>
        <source>In the unit</source>
        <translation>产品内</translation>
    </message>
    <message>
        <source>Write, table at rest</source>
        <translation>写入，转台不动</translation>
    </message>
    <message>
        <source>Write and turn the table</source>
        <translation>写入并转动转台</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>Write {0} registers</source>
        <translation>写入 {0} 个寄存器</translation>
    </message>
</context>
<context>
    <name>ResidualsView</name>
    <message>
        <source>test, σ</source>
        <translation>检验值，σ</translation>
    </message>
    <message>
        <source>gravity, µg</source>
        <translation>重力，µg</translation>
    </message>
    <message>
        <source>vertical, °/h</source>
        <translation>垂向角速率，°/h</translation>
    </message>
    <message>
        <source>horizontal, °/h</source>
        <translation>水平角速率，°/h</translation>
    </message>
    <message>
        <source>rest, by the axis that is up</source>
        <translation>静止位置，按朝上的轴</translation>
    </message>
</context>
<context>
    <name>ResultAnalysis</name>
    <message>
        <source>Opening {0}</source>
        <translation>正在打开 {0}</translation>
    </message>
</context>
<context>
    <name>ResultView</name>
    <message>
        <source>Unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>Value</source>
        <translation>数值</translation>
    </message>
    <message>
        <source>± σ</source>
        <translation>± σ</translation>
    </message>
    <message>
        <source>Previous</source>
        <translation>上次</translation>
    </message>
    <message>
        <source>Change</source>
        <translation>变化</translation>
    </message>
    <message>
        <source>in σ</source>
        <translation>折合 σ</translation>
    </message>
    <message>
        <source>Value limit</source>
        <translation>数值限差</translation>
    </message>
    <message>
        <source>Accepted</source>
        <translation>接受区间</translation>
    </message>
    <message>
        <source>σ limit</source>
        <translation>σ 限差</translation>
    </message>
    <message>
        <source>Stage</source>
        <translation>阶段</translation>
    </message>
    <message>
        <source>Verdict</source>
        <translation>结论</translation>
    </message>
    <message>
        <source>Copy table</source>
        <translation>复制表格</translation>
    </message>
    <message>
        <source>The selected rows, or all, as a table for a spreadsheet (Ctrl+C)</source>
        <translation>复制所选行或全部，可粘贴到电子表格（Ctrl+C）</translation>
    </message>
    <message>
        <source>Parameters of the run</source>
        <translation>标定参数</translation>
    </message>
    <message>
        <source>Without state</source>
        <translation>无该状态</translation>
    </message>
    <message>
        <source>{0} of {1} checks passed</source>
        <translation>{1} 项检查，{0} 项合格</translation>
    </message>
    <message>
        <source>near-misses: {0}</source>
        <translation>临界 {0} 项</translation>
    </message>
</context>
<context>
    <name>SaveBar</name>
    <message>
        <source>Save</source>
        <translation>保存</translation>
    </message>
    <message>
        <source>Name of the product</source>
        <translation>产品名称</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>Only letters a to z, digits, - and _; a letter or digit first.</source>
        <translation>只能用小写字母、数字、- 和 _，以字母或数字开头。</translation>
    </message>
    <message>
        <source>The product keeps its own stages; choose another name.</source>
        <translation>原产品保留自己的阶段，请换一个名称。</translation>
    </message>
    <message>
        <source>Type a name first.</source>
        <translation>请先输入名称。</translation>
    </message>
</context>
<context>
    <name>Sphere</name>
    <message>
        <source>— planned</source>
        <translation>— 计划</translation>
    </message>
    <message>
        <source>- - reserve</source>
        <translation>- - 备用</translation>
    </message>
</context>
<context>
    <name>SphereBox</name>
    <message>
        <source>Turn the sphere</source>
        <translation>转动球面</translation>
    </message>
    <message>
        <source>Direction of gravity in the axes of the unit</source>
        <translation>重力在产品坐标系中的方向</translation>
    </message>
    <message>
        <source>Turn</source>
        <translation>转动</translation>
    </message>
</context>
<context>
    <name>EngineerHeader</name>
    <message>
        <source>Serial number</source>
        <translation>序列号</translation>
    </message>
    <message>
        <source>Your name</source>
        <translation>姓名</translation>
    </message>
    <message>
        <source>scan or type</source>
        <translation>扫码或输入</translation>
    </message>
    <message>
        <source>your name, for the record</source>
        <translation>您的姓名，用于记录</translation>
    </message>
    <message>
        <source>START</source>
        <translation>开始</translation>
    </message>
    <message>
        <source>START PARTIAL</source>
        <translation>开始部分标定</translation>
    </message>
    <message>
        <source>Serial number: next unit</source>
        <translation>序列号：下一个产品</translation>
    </message>
</context>
<context>
    <name>_StageRow</name>
    <message>
        <source>Move {0} one up</source>
        <translation>{0}上移一位</translation>
    </message>
    <message>
        <source>Move {0} one down</source>
        <translation>{0}下移一位</translation>
    </message>
</context>
</TS>
